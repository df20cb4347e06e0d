// The file and its writing thread. See recorder.h.
#include "server/observe/recorder.h"

#include <fcntl.h>
#include <google/protobuf/io/coded_stream.h>
#include <sys/stat.h>

#include <array>
#include <chrono>
#include <ctime>
#include <filesystem>

#include "server/os/hash.h"

namespace heliograph::server {
namespace {

using google::protobuf::io::CodedOutputStream;

constexpr auto kPause = std::chrono::milliseconds(50);
constexpr u64 kWakeBytes = 4 << 20;      // from here on the writer does not pause
constexpr u64 kMuchWaiting = 64 << 20;   // bytes; from here on calls hash in their own threads
constexpr u64 kMostWaiting = 256 << 20;  // bytes; beyond it the recording ends
constexpr u64 kLastBytes = 512;          // reserved for the closing item
constexpr std::size_t kPiece = 1 << 20;
constexpr const char* kLate = "the disk is too slow";
constexpr const char* kSuffix = ".recording";

namespace fs = std::filesystem;

/// Location of the recordings of one --record, one file per run.
struct Place {
  fs::path folder;
  std::string name;  // prefix of their names
  std::string suffix;
  bool is_folder = false;  // --record names a folder
};

Place place_of(const fs::path& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored))
    return {.folder = path, .name = "heliograph", .suffix = kSuffix, .is_folder = true};
  return {.folder = path.has_parent_path() ? path.parent_path() : ".",
          .name = path.stem(),
          .suffix = path.extension()};
}

u64 bytes_in(const Place& place) {
  u64 bytes = 0;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(place.folder, error)) {
    const fs::path& path = entry.path();
    const std::string stem = path.stem();
    const bool is_ours =
        place.is_folder || stem == place.name || stem.starts_with(place.name + "-");
    if (is_ours && path.extension() == place.suffix) bytes += entry.file_size(error);
  }
  return bytes;
}

fs::path dated(const Place& place) {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y%m%dT%H%M%SZ", &utc);
  return place.folder / fmt::format("{}-{}-{}{}", place.name, text, ::getpid(), place.suffix);
}

UniqueFd make_file(const fs::path& path) {
  return UniqueFd(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC,
                         S_IRUSR | S_IWUSR));
}

}  // namespace

Expected<std::unique_ptr<Recorder>> Recorder::open(Options options, const Log& log) {
  const Place place = place_of(options.path);
  const u64 room = options.bytes - std::min(options.bytes, bytes_in(place));
  fs::path path = place.is_folder ? dated(place) : fs::path(options.path);
  UniqueFd file = make_file(path);
  if (!file && errno == EEXIST && !place.is_folder) {
    path = dated(place);
    file = make_file(path);
  }
  if (!file)
    return fail(Code::kInvalidArgument, "--record",
                fmt::format("{}: {}; name a file or a folder that the daemon may write",
                            path.string(), std::generic_category().message(errno)));
  log.info("recording", {{"file", path.string()}});
  std::unique_ptr<Recorder> made(
      new Recorder(std::move(file), room - std::min(room, kLastBytes), log));
  options.header.set_format("heliograph.recording");
  options.header.set_version(2);
  options.header.set_time(double(std::time(nullptr)));
  Note first;
  *first.item.mutable_header() = std::move(options.header);
  made->note(std::move(first));
  made->thread_ = std::thread([recorder = made.get()] { recorder->work(); });
  return made;
}

// ---------------------------------------------------------------- any thread

void Recorder::note(Note note) {
  if (!is_on_) return;
  if (is_busy_) hash(note);
  const u64 cost = bytes_of(note);
  const std::lock_guard lock(mutex_);
  if (is_late_) return;
  is_late_ = waiting_bytes_ > 0 && waiting_bytes_ + cost > kMostWaiting;
  if (is_late_) return wake_.notify_all();
  waiting_bytes_ += cost;
  is_busy_ = waiting_bytes_ > kMuchWaiting;
  notes_.push_back(std::move(note));
  if (waiting_bytes_ > kWakeBytes) wake_.notify_all();
}

void Recorder::open_session(u64 id, v1::RecordSession session) {
  {
    const std::lock_guard lock(mutex_);
    session.set_session(++last_session_);
    sessions_[id] = session.session();
  }
  Note opened;
  *opened.item.mutable_session() = std::move(session);
  note(std::move(opened));
}

void Recorder::end_session(u64 id) {
  Note ended;
  {
    const std::lock_guard lock(mutex_);
    const auto found = sessions_.extract(id);
    if (!found) return;
    ended.item.mutable_session_end()->set_session(found.mapped());
  }
  note(std::move(ended));
}

u64 Recorder::session(u64 id) const {
  const std::lock_guard lock(mutex_);
  const auto found = sessions_.find(id);
  return found == sessions_.end() ? 0 : found->second;
}

void Recorder::frame(const void* context, std::shared_ptr<const Frame> frame) {
  if (!is_on_) return;
  const std::lock_guard lock(mutex_);
  frames_[context] = std::move(frame);
}

std::shared_ptr<const Frame> Recorder::take_frame(const void* context) {
  const std::lock_guard lock(mutex_);
  auto node = frames_.extract(context);
  return node ? std::move(node.mapped()) : nullptr;
}

void Recorder::revision(const void* context, u64 revision) {
  if (!is_on_) return;
  const std::lock_guard lock(mutex_);
  revisions_[context] = revision;
}

std::optional<u64> Recorder::take_revision(const void* context) {
  const std::lock_guard lock(mutex_);
  const auto node = revisions_.extract(context);
  return node ? std::optional(node.mapped()) : std::nullopt;
}

void Recorder::buffer(u64 session, u64 buffer, int memory) {
  Note shared;
  shared.item.mutable_buffer()->set_session(this->session(session));
  shared.item.mutable_buffer()->set_buffer(buffer);
  shared.memory = UniqueFd(::fcntl(memory, F_DUPFD_CLOEXEC, 0));
  if (is_on_) note(std::move(shared));
}

void Recorder::stop(const std::string& reason) {
  {
    const std::lock_guard lock(mutex_);
    if (reason_.empty()) reason_ = reason;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
}

// ---------------------------------------------------------------- the writer's thread

void Recorder::work() {
  while (is_on_) {
    std::vector<Note> notes;
    std::string reason;
    {
      std::unique_lock lock(mutex_);
      wake_.wait_for(lock, kPause,
                     [&] { return waiting_bytes_ > kWakeBytes || is_late_ || !reason_.empty(); });
      notes.swap(notes_);
      waiting_bytes_ = 0;
      is_busy_ = false;
      reason = is_late_ ? kLate : reason_;
    }
    if (reason == kLate) warn(reason);
    write(std::move(notes));
    if (!reason.empty()) end(reason);
  }
  const std::lock_guard lock(mutex_);
  notes_.clear();
}

void Recorder::write(std::vector<Note> notes) {
  for (Note& note : notes) {
    if (!is_on_) return;
    complete(note);
    put(note.item);
    if (out_.size() > kWakeBytes) flush();
  }
  flush();
}

void Recorder::complete(Note& note) {
  hash(note);
  if (!note.bulk.empty()) {
    const std::string hash = store(std::move(note.bulk));
    if (note.item.has_request())
      note.item.mutable_request()->set_sha256(hash);
    else
      note.item.mutable_reply()->set_sha256(hash);
  }
  if (note.memory) store_memory(note.memory, *note.item.mutable_buffer());
}

std::string Recorder::store(std::string bytes) {
  std::string hash = sha256(bytes);
  if (bytes.size() >= kWorthNaming && !stored_.insert(hash).second) return hash;
  v1::RecordItem item;
  item.mutable_bytes()->set_sha256(hash);
  item.mutable_bytes()->set_data(std::move(bytes));
  put(item);
  return hash;
}

void Recorder::store_memory(const UniqueFd& memory, v1::RecordBuffer& buffer) {
  off_t offset = 0;
  while (is_on_) {
    std::string piece(kPiece, '\0');
    const auto size = ::pread(memory.get(), piece.data(), piece.size(), offset);
    if (size <= 0) return;
    piece.resize(std::size_t(size));
    offset += size;
    buffer.add_sha256(store(std::move(piece)));
  }
}

void Recorder::put(const v1::RecordItem& item) {
  if (!is_on_) return;
  const u64 size = item.ByteSizeLong();
  const u64 needed = size + u64(CodedOutputStream::VarintSize64(size));
  if (needed > room_) {
    const std::string reason = "it has as many bytes as it may (limit record_bytes)";
    warn(reason);
    return end(reason);
  }
  room_ -= needed;
  std::array<u8, 10> length{};
  out_.append(length.data(), CodedOutputStream::WriteVarint64ToArray(size, length.data()));
  item.AppendToString(&out_);  // a StringOutputStream would zero the string's whole capacity
}

void Recorder::flush() {
  std::string_view left = out_;
  while (!left.empty()) {
    const auto written = ::write(file_.get(), left.data(), left.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) {
      warn(std::generic_category().message(errno));
      is_on_ = false;
      break;
    }
    left.remove_prefix(std::size_t(written));
  }
  out_.clear();
}

void Recorder::warn(const std::string& reason) const {
  log_.warning("the recording ends", {{"reason", reason}});
}

void Recorder::end(const std::string& reason) {
  room_ = kLastBytes;
  v1::RecordItem item;
  item.mutable_end()->set_reason(reason);
  put(item);
  flush();
  is_on_ = false;
}

}  // namespace heliograph::server
