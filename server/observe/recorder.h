// Recording of requests and replies (heliographd --record), in the format of recording.proto.
// Filled by record_calls.h, by the calls that reply with frames, and by the sessions.
#pragma once

#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "server/observe/note.h"
#include "server/os/log.h"

namespace heliograph::server {

/// Owns: the file and the thread that writes it, 20 times per second. Hashing is done by that
/// thread, or by the calls while much is queued, which slows heavy callers and bounds the queue.
/// Ends with a log line at the size limit, at a disk error, or when the queue grows beyond its
/// limit. Thread: any.
class Recorder {
 public:
  struct Options {
    /// A file, or a folder to make one in. An existing file is kept: the new one gets the time in
    /// its name.
    std::string path;
    u64 bytes = 1ull << 30;  // of all recordings of this path
    v1::RecordHeader header;
  };
  /// Creates the file. INVALID_ARGUMENT: it cannot be created.
  [[nodiscard]] static Expected<std::unique_ptr<Recorder>> open(Options options, const Log& log);
  ~Recorder() { stop("the daemon ended"); }

  /// Returns true while notes are written.
  [[nodiscard]] bool is_on() const { return is_on_; }
  void note(Note note);

  void open_session(u64 id, v1::RecordSession session);
  void end_session(u64 id);
  /// Returns the recording's number of an open session; 0: unknown.
  [[nodiscard]] u64 session(u64 id) const;
  [[nodiscard]] u64 next_call() { return ++last_call_; }
  /// Notes the frame that the call of this context sends next.
  void frame(const void* context, std::shared_ptr<const Frame> frame);
  [[nodiscard]] std::shared_ptr<const Frame> take_frame(const void* context);
  /// Notes the revision that the query of this context reads.
  void revision(const void* context, u64 revision);
  [[nodiscard]] std::optional<u64> take_revision(const void* context);
  /// Notes sealed memory that a session's client handed over.
  void buffer(u64 session, u64 buffer, int memory);

  /// Writes the queue and the reason, and ends the recording.
  void stop(const std::string& reason);

 private:
  Recorder(UniqueFd file, u64 room, const Log& log)
      : log_(log), file_(std::move(file)), room_(room) {}
  void work();
  void write(std::vector<Note> notes);
  void complete(Note& note);
  [[nodiscard]] std::string store(std::string bytes);
  void store_memory(const UniqueFd& memory, v1::RecordBuffer& buffer);
  void put(const v1::RecordItem& item);
  void flush();
  void warn(const std::string& reason) const;
  void end(const std::string& reason);

  const Log& log_;
  std::atomic<bool> is_on_ = true;
  std::atomic<bool> is_busy_ = false;  // the queue is long
  std::atomic<u64> last_call_ = 0;

  // Accessed by the writer only.
  const UniqueFd file_;
  u64 room_;  // bytes that may still be written
  std::string out_;
  std::unordered_set<std::string> stored_;  // hashes of stored data

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::vector<Note> notes_;
  u64 waiting_bytes_ = 0;
  bool is_late_ = false;  // the queue is too long
  std::string reason_;    // reason to stop; "": none
  std::unordered_map<u64, u64> sessions_;
  u64 last_session_ = 0;
  std::unordered_map<const void*, std::shared_ptr<const Frame>> frames_;  // by context
  std::unordered_map<const void*, u64> revisions_;                        // by context
  std::thread thread_;
};

}  // namespace heliograph::server
