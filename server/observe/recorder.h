// The recording of what clients ask and are answered (heliographd --record), in the format of
// recording.proto. Filled by record_calls.h, by the calls that answer with frames, and by the
// sessions.
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

/// Owns: the file and the thread that writes it, twenty times a second. Hashing is that thread's,
/// or the call's while much waits: who asks for much is slowed, and the writer never has too much.
/// Ends with a line in the log when the file is as long as it may be, when the disk fails, or when
/// it is too slow for what waits. Thread: any.
class Recorder {
 public:
  struct Options {
    /// A file, or a folder that one is made in. Where the file is there already, the new one stands
    /// beside it, with the time in its name.
    std::string path;
    u64 bytes = 1ull << 30;  // of all its recordings
    v1::RecordHeader header;
  };
  /// INVALID_ARGUMENT: no file can be made there.
  [[nodiscard]] static Expected<std::unique_ptr<Recorder>> open(Options options, const Log& log);
  ~Recorder() { stop("the daemon ended"); }

  /// Whether what is noted is still written.
  [[nodiscard]] bool is_on() const { return is_on_; }
  void note(Note note);

  void open_session(u64 id, v1::RecordSession session);
  void end_session(u64 id);
  /// The number of an open session; 0: it is not known.
  [[nodiscard]] u64 session(u64 id) const;
  [[nodiscard]] u64 next_call() { return ++last_call_; }
  /// A frame that the call of this context sends next, and which frame that was.
  void frame(const void* context, std::shared_ptr<const Frame> frame);
  [[nodiscard]] std::shared_ptr<const Frame> take_frame(const void* context);
  /// The revision that the call of this context, a question, looks at.
  void revision(const void* context, u64 revision);
  [[nodiscard]] std::optional<u64> take_revision(const void* context);
  /// Sealed memory that a session's client handed over.
  void buffer(u64 session, u64 buffer, int memory);

  /// Writes what waits, and why this is the end.
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
  std::atomic<bool> is_busy_ = false;  // much waits
  std::atomic<u64> last_call_ = 0;

  // The writer's alone.
  const UniqueFd file_;
  u64 room_;  // bytes that may still be written
  std::string out_;
  std::unordered_set<std::string> stored_;  // hashes

  mutable std::mutex mutex_;
  std::condition_variable wake_;
  std::vector<Note> notes_;
  u64 waiting_bytes_ = 0;
  bool is_late_ = false;  // too much waits
  std::string reason_;    // why it is to stop; "": it is not
  std::unordered_map<u64, u64> sessions_;
  u64 last_session_ = 0;
  std::unordered_map<const void*, std::shared_ptr<const Frame>> frames_;  // by context
  std::unordered_map<const void*, u64> revisions_;                        // by context
  std::thread thread_;
};

}  // namespace heliograph::server
