// Leases of buffers: whose memory they are of, what ends them, what is never used again.
#include <map>
#include <optional>
#include <utility>

#include "renderer/frame/lent_memory.h"
#include "server/store/shared_frames.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

constexpr u64 kStep = 1 << 20;
constexpr DeviceUuid kUuid{1, 2, 3};

class FakeMemory final : public LentMemory {
 public:
  FakeMemory(u64 bytes, i64& alive) : alive_(alive), bytes_(bytes) { ++alive_; }
  ~FakeMemory() override { --alive_; }
  [[nodiscard]] int fd() const override { return -1; }
  [[nodiscard]] std::span<std::byte> bytes() const override {
    return {reinterpret_cast<std::byte*>(kStep), bytes_};  // where the host cannot read
  }
  [[nodiscard]] const DeviceUuid* device() const override { return &kUuid; }
  [[nodiscard]] Status read(u64 offset, u64 size, const TakePiece& take) const override {
    constexpr u64 kPiece = 256;
    std::array<std::byte, kPiece> piece;
    for (u64 begin = 0; begin < size; begin += kPiece) {
      const u64 bytes = std::min(kPiece, size - begin);
      for (u64 i = 0; i < bytes; ++i) piece[i] = std::byte((offset + begin + i) * 7 % 251);
      take(begin, std::span(piece).first(bytes));
    }
    return {};
  }
  /// Of poses there are none; floats are all 1.
  [[nodiscard]] Expected<BufferPtr> take(u64, u64 size, Numbers kind) const override {
    if (kind == Numbers::kPoses) return nullptr;
    const ArrayOf<float> ones(std::vector<float>(size / sizeof(float), 1.0f));
    return std::make_shared<const Buffer>(ones.buffer(), ones.buffer()->bytes(),
                                          Buffer::Kind::kPooled);
  }

 private:
  i64& alive_;
  const u64 bytes_;
};

class FakeSource final : public SharedMemorySource {
 public:
  [[nodiscard]] std::shared_ptr<SharedMemory> make(u64 bytes) override {
    if (before) before();
    if (is_full || alive >= most) return nullptr;
    CHECK(bytes % kStep == 0);
    return std::make_shared<FakeMemory>(bytes, alive);
  }
  void know(const std::weak_ptr<SharedMemoryKeeper>& each) override { keeper = each; }
  [[nodiscard]] u64 step() const override { return kStep; }
  [[nodiscard]] const DeviceUuid* device() const override { return &kUuid; }
  i64 alive = 0;
  std::weak_ptr<SharedMemoryKeeper> keeper;
  std::function<void()> before;  // it makes some
  i64 most = 100;
  bool is_full = false;
};

struct Stage {
  std::map<u64, u64> told;  // buffer -> bytes, of those that were not forgotten
  std::shared_ptr<Budget> budget = std::make_shared<Budget>(
      64 * kStep, Budget::RefusalText{"bytes", "remove some", "tenant_bytes"});
  std::shared_ptr<FakeSource> gpu = std::make_shared<FakeSource>();
  std::shared_ptr<Budget> descriptors = std::make_shared<Budget>(
      16, Budget::RefusalText{"descriptors", "let go of frames", "descriptors"});
  SharedFrames frames{{8 * kStep, budget, descriptors},
                      [this](u64 buffer, const SharedMemory* memory) {
                        if (memory)
                          told[buffer] = memory->bytes().size();
                        else
                          told.erase(buffer);
                        return true;
                      },
                      [this] {
                        if (const auto ended = std::exchange(unread, std::nullopt))
                          frames.give_back(ended->buffer, ended->generation);
                      }};
  std::optional<Lease> unread;  // its end lies in the socket
};

}  // namespace

TEST_CASE("shared frames: a lease is of the memory that was asked for") {
  Stage stage;
  const auto host = stage.frames.lease(100, 1);
  const auto gpu = stage.frames.lease(100, 1, stage.gpu);
  REQUIRE((host && gpu));
  CHECK(host->memory->device() == nullptr);
  CHECK(host->memory->bytes()[99] == std::byte(0));
  CHECK(*gpu->memory->device() == kUuid);
  CHECK((host->bytes.size() == 128 && stage.told[gpu->buffer] == kStep));
  const u64 before = gpu->buffer;
  stage.frames.give_back(host->buffer, host->generation);
  CHECK(stage.frames.lease(100, 1, stage.gpu)->buffer != before);
  const std::shared_ptr<SharedFrames> frames(std::shared_ptr<void>(), &stage.frames);
  CHECK(LeasedPixels(frames, *gpu).send().buffer == before);
}

TEST_CASE("shared frames: device memory is used again once its generation came back") {
  Stage stage;
  for (int i = 0; i < 20; ++i) {
    const auto lease = stage.frames.lease(1000 + 70'000 * u64(i % 10), 1, stage.gpu);
    REQUIRE(lease);
    CHECK(stage.frames.used() == std::pair<u64, u32>(kStep, 1));
    stage.frames.give_back(lease->buffer, lease->generation + 1);
    CHECK(stage.frames.used().second == 1);
    stage.frames.give_back(lease->buffer, lease->generation);
  }
  CHECK(stage.told.size() == 1);
}

TEST_CASE("shared frames: leases whose ends were not read yet are used before memory is made") {
  Stage stage;
  for (int i = 0; i < 20; ++i) {
    const auto lease = stage.frames.lease(kStep, 1, stage.gpu);
    REQUIRE(lease);
    CHECK((stage.gpu->alive == 1 && !stage.unread));
    stage.unread = lease;
  }
}

TEST_CASE("shared frames: ranges whose ends were not read yet are used before an arena is made") {
  Stage stage;
  for (int i = 0; i < 20; ++i) {
    const auto lease = stage.frames.lease(kStep, 1);
    REQUIRE(lease);
    CHECK((stage.told.size() == 1 && stage.frames.used() == std::pair<u64, u32>(kStep, 1)));
    stage.frames.let_be(*lease, true);
    stage.unread = lease;
  }
}

TEST_CASE("shared frames: what a call left is not used again") {
  Stage stage;
  (void)stage.frames.lease(kStep, 7, stage.gpu);
  CHECK(stage.gpu->alive == 1);
  stage.frames.abandon(7);
  CHECK((stage.gpu->alive == 0 && stage.told.empty() && stage.budget->used() == 0));
}

TEST_CASE("shared frames: what a client has written is read while it holds the buffer") {
  Stage stage;
  const auto lease = stage.frames.lease(kStep, 7, stage.gpu);
  const auto ref = [&](u64 offset, u64 size) {
    v1::BufferRef named;
    named.set_buffer(lease->buffer);
    named.set_generation(lease->generation);
    named.set_offset(offset);
    named.set_size(size);
    return named;
  };
  {
    const auto bytes = stage.frames.copy(ref(64, 1000));
    REQUIRE(bytes);
    CHECK((*bytes)->bytes()[900] == std::byte(964 * 7 % 251));
    CHECK(((*bytes)->bytes().size() == 1000 && stage.budget->used() == kStep + 1000));
  }
  CHECK(stage.budget->used() == kStep);
  {
    const auto floats = stage.frames.take(ref(0, 1000), Numbers::kFloats);
    REQUIRE((floats && *floats));
    CHECK(ArrayOf<float>(*floats)[249] == 1);
    CHECK((*floats)->kind() == heliograph::Buffer::Kind::kPooled);
    CHECK(stage.budget->used() == kStep + 1000);
    const auto poses = stage.frames.take(ref(0, 640), Numbers::kPoses);
    REQUIRE(poses);
    CHECK_FALSE(*poses);
    CHECK(stage.budget->used() == kStep + 1000);
  }
  CHECK(stage.budget->used() == kStep);
  u64 read = 0;
  const auto take = [&](u64 begin, std::span<const std::byte> piece) {
    CHECK((begin == read && piece[0] == std::byte((3 + begin) * 7 % 251)));
    read += piece.size();
    CHECK(stage.budget->used() == kStep);  // nothing is copied
  };
  REQUIRE(stage.frames.read(ref(3, 600), take));
  CHECK(read == 600);
  v1::BufferRef older = ref(0, 1), other = ref(0, 1);
  older.set_generation(lease->generation + 1);
  other.set_buffer(99);
  const auto refused = [&](const v1::BufferRef& named, Code code) {
    CHECK(stage.frames.copy(named).error().code == code);
    CHECK(stage.frames.read(named, take).error().code == code);
    CHECK(stage.frames.take(named, Numbers::kFloats).error().code == code);
  };
  refused(older, Code::kNotFound);
  refused(other, Code::kNotFound);
  refused(ref(kStep, 1), Code::kInvalidArgument);
  refused(ref(~u64(0), 64), Code::kInvalidArgument);
  refused(ref(64, ~u64(0)), Code::kInvalidArgument);
  stage.frames.give_back(lease->buffer, lease->generation);
  refused(ref(0, 1), Code::kNotFound);
  CHECK(read == 600);
}

TEST_CASE("shared frames: a buffer that nobody can tell about is not used again") {
  Stage stage;
  const auto kept =
      stage.frames.lease(kStep, 2, stage.gpu);  // its call has another buffer's number
  const auto lost = stage.frames.lease(kStep, 3, stage.gpu);
  REQUIRE((kept->buffer == 1 && lost->buffer == 2));
  stage.frames.give_up(lost->generation);
  CHECK((stage.told.count(1) == 1 && stage.told.count(2) == 0));
  stage.frames.give_up(99);
  CHECK(stage.frames.used() == std::pair<u64, u32>(kStep, 1));
}

TEST_CASE("shared frames: without room there is no lease, on a device neither") {
  Stage stage;
  CHECK_FALSE(stage.frames.lease(9 * kStep, 1, stage.gpu));
  stage.gpu->is_full = true;
  CHECK_FALSE(stage.frames.lease(kStep, 1, stage.gpu));
  CHECK((stage.told.empty() && stage.budget->used() == 0));
}

TEST_CASE("shared frames: a full device gets back what the session keeps for later") {
  Stage stage;
  stage.gpu->most = 3;
  const auto held = stage.frames.lease(kStep, 1, stage.gpu);
  const auto host = stage.frames.lease(kStep, 1);
  for (const u64 count : {1, 2}) {
    const auto free = stage.frames.lease(kStep * count, 1, stage.gpu);
    REQUIRE(free);
    stage.frames.give_back(free->buffer, free->generation);
  }
  CHECK(stage.gpu->alive == 3);
  stage.frames.give_back(host->buffer, host->generation);
  CHECK(stage.frames.lease(3 * kStep, 2, stage.gpu));
  CHECK(stage.gpu->alive == 2);
  CHECK(stage.told.count(held->buffer) == 1);
  CHECK(stage.told.count(host->buffer) == 1);
}

TEST_CASE("shared frames: what is kept for later makes room for others") {
  Stage stage;
  const auto frames = std::make_shared<SharedFrames>(
      SharedRoom::Limits{8 * kStep, stage.budget, stage.descriptors},
      [](u64, const SharedMemory*) { return true; }, [] {});
  const auto held = frames->lease(kStep, 1, stage.gpu);
  const auto free = frames->lease(kStep, 1, stage.gpu);
  const auto host = frames->lease(kStep, 1);
  const auto keeper = stage.gpu->keeper.lock();
  REQUIRE(keeper == frames);
  CHECK_FALSE(keeper->let_go(*stage.gpu));
  frames->give_back(free->buffer, free->generation);
  frames->give_back(host->buffer, host->generation);
  frames->let_be(*host, true);
  CHECK_FALSE(keeper->let_go(*std::make_shared<FakeSource>()));
  bool has_let_go = true;
  stage.gpu->before = [&] { has_let_go = keeper->let_go(*stage.gpu); };  // by who asks for more
  (void)frames->lease(4 * kStep, 2, stage.gpu);
  CHECK_FALSE(has_let_go);
  CHECK(stage.gpu->alive == 3);
  CHECK(keeper->let_go(*stage.gpu));
  CHECK(frames->used() == std::pair<u64, u32>(6 * kStep, 2));
}

TEST_CASE("shared frames: a device's memory ends with what replaces the device") {
  Stage stage;
  const auto held = stage.frames.lease(kStep, 1, stage.gpu);
  const auto free = stage.frames.lease(kStep, 1, stage.gpu);
  const auto host = stage.frames.lease(kStep, 1);
  stage.frames.give_back(free->buffer, free->generation);
  const auto next = std::make_shared<FakeSource>();
  const auto lease = stage.frames.lease(kStep, 2, next);
  REQUIRE(lease);
  CHECK(next->alive == 1);
  CHECK((stage.told.count(held->buffer) == 1 && stage.told.count(free->buffer) == 0));
  CHECK(stage.told.count(host->buffer) == 1);
}
