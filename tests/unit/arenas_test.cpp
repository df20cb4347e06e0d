// Frames in the host's memory: how few arenas they lie in, what they are charged, what ends an
// arena, what a client that lies gets.
#include <fcntl.h>

#include <cstring>
#include <map>
#include <set>

#include "server/store/shared_frames.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

constexpr u64 kMiB = 1 << 20;
constexpr u64 kPage = 4096;

struct Stage {
  explicit Stage(u64 limit = 4096 * kMiB, u64 tenant = 4096 * kMiB, u64 most_descriptors = 4096)
      : budget(std::make_shared<Budget>(
            tenant, Budget::RefusalText{"bytes", "remove some", "tenant_bytes"})),
        descriptors(std::make_shared<Budget>(
            most_descriptors, Budget::RefusalText{"descriptors", "give some back", "descriptors"})),
        frames(std::make_shared<SharedFrames>(
            SharedRoom::Limits{limit, budget, descriptors},
            [this](u64 buffer, const SharedMemory* memory) {
              if (!takes) return false;
              if (memory) {
                told[buffer] = memory->bytes().size();
                ++announced;
              } else {
                told.erase(buffer);
              }
              return true;
            },
            [] {})) {}

  /// A plane that was sent, and that the daemon reads no more.
  [[nodiscard]] std::optional<Lease> sent(u64 bytes, u64 call = 0) const {
    auto lease = frames->lease(bytes, call);
    if (lease) frames->let_be(*lease, true);
    return lease;
  }
  void give_back(const Lease& lease) const { frames->give_back(lease.buffer, lease.generation); }

  std::map<u64, u64> told;  // buffer -> bytes, of those that were not forgotten
  u64 announced = 0;
  bool takes = true;  // the socket
  std::shared_ptr<Budget> budget;
  std::shared_ptr<Budget> descriptors;
  std::shared_ptr<SharedFrames> frames;
};

}  // namespace

TEST_CASE("arenas: 100,000 small frames lie in a few") {
  Stage stage;
  constexpr u64 kFrame = 16 * 16 * 3 * sizeof(float);
  std::set<std::pair<u64, u64>> places;
  for (u64 i = 0; i < 100'000; ++i) {
    const auto lease = stage.sent(kFrame);
    REQUIRE(lease);
    REQUIRE(lease->offset % 64 == 0);
    REQUIRE(lease->offset + kFrame <= stage.told[lease->buffer]);
    REQUIRE(lease->bytes.data() == lease->memory->bytes().data() + lease->offset);
    places.emplace(lease->buffer, lease->offset / kFrame);
  }
  CHECK(places.size() == 100'000);
  CHECK(stage.told.size() < 15);
  CHECK(stage.frames->used().second == 100'000);
  CHECK(stage.budget->used() < 100'000 * kFrame + stage.told.size() * kPage);
}

TEST_CASE("arenas: what came back is used again, and nothing else") {
  Stage stage;
  const auto first = stage.sent(100'000), second = stage.sent(100'000);
  std::memset(second->bytes.data(), 7, 100'000);
  for (int i = 0; i < 50; ++i) {
    stage.give_back(*first);
    const auto again = stage.sent(90'000);
    CHECK((again->buffer == first->buffer && again->offset == first->offset));
    CHECK(again->generation > first->generation);
    std::memset(again->bytes.data(), i, 90'000);
    stage.give_back(*first);  // an older use of the same place
    CHECK(stage.frames->used().second == 2);
    stage.give_back(*again);
    stage.give_back(*again);
    CHECK(stage.frames->used().second == 1);
  }
  CHECK((stage.announced == 1 && second->bytes[99'999] == std::byte(7)));
}

TEST_CASE("arenas: a range that the daemon still reads is not used again") {
  Stage stage;
  const auto kept = stage.frames->lease(100'000, 0);
  stage.give_back(*kept);
  CHECK(stage.sent(100'000)->offset != kept->offset);
  stage.frames->let_be(*kept, true);
  CHECK(stage.sent(100'000)->offset == kept->offset);
}

TEST_CASE("arenas: pixels that are not sent give their range back") {
  Stage stage;
  {
    const LeasedPixels pixels(stage.frames, *stage.frames->lease(100'000, 0));
  }
  CHECK(stage.frames->used().second == 0);
  {
    LeasedPixels pixels(stage.frames, *stage.frames->lease(100'000, 0));
    CHECK(pixels.bytes().size() >= 100'000);
    CHECK(pixels.send().offset == 0);
  }
  CHECK(stage.frames->used().second == 1);
}

TEST_CASE("arenas: what was in use is charged, page by page, until the arena ends") {
  Stage stage;
  const auto small = stage.sent(100);
  CHECK(stage.budget->used() == kPage);
  const auto large = stage.sent(500'000);
  const u64 both = (100 / 64 + 1) * 64 + 500'000 / 64 * 64 + 64;
  CHECK(stage.budget->used() == (both + kPage - 1) / kPage * kPage);
  CHECK(stage.frames->used().first == stage.budget->used());
  stage.give_back(*small);
  stage.give_back(*large);
  CHECK(stage.budget->used() > 500'000);  // the pages are there
  CHECK(stage.frames->unmapped(small->buffer));
  CHECK((stage.budget->used() == 0 && stage.frames->used() == std::pair<u64, u32>(0, 0)));
}

TEST_CASE("arenas: a frame that needs more than an arena has one to itself") {
  Stage stage;
  const auto huge = stage.sent(100 * kMiB + 1);
  CHECK(stage.told[huge->buffer] == 100 * kMiB + kPage);
  const auto next = stage.sent(kMiB);
  CHECK((next->buffer != huge->buffer && stage.told[next->buffer] == 64 * kMiB));
}

TEST_CASE("arenas: without room there is no lease, and nothing stays charged") {
  Stage stage(10 * kMiB, 4 * kMiB);
  CHECK_FALSE(stage.sent(11 * kMiB));
  CHECK_FALSE(stage.sent(5 * kMiB));
  stage.takes = false;
  CHECK_FALSE(stage.sent(kMiB));
  stage.takes = true;
  CHECK((stage.budget->used() == 0 && stage.frames->used().first == 0));
  const auto held = stage.sent(3 * kMiB);
  CHECK_FALSE(stage.sent(2 * kMiB));
  stage.give_back(*held);
  CHECK(stage.sent(4 * kMiB));  // the free arena ended for it
  CHECK((stage.told.size() == 1 && stage.budget->used() == 4 * kMiB));
}

TEST_CASE("arenas: a use that is lost is not used again, nor its arena, which ends with the rest") {
  Stage stage;
  const u64 call = stage.frames->new_call();
  const auto kept = stage.sent(100'000);
  const auto lost = stage.sent(100'000, call);
  const auto later = stage.sent(100'000, stage.frames->new_call());
  SECTION("its call is abandoned") { stage.frames->abandon(call); }
  SECTION("its client cannot tell") { stage.frames->give_up(lost->generation); }
  CHECK(stage.frames->used().second == 2);
  stage.give_back(*lost);
  const auto next = stage.sent(100'000);
  CHECK(next->buffer != lost->buffer);
  stage.give_back(*kept);
  CHECK(stage.told.count(kept->buffer) == 1);
  const auto memory = later->memory;
  stage.give_back(*later);
  CHECK((stage.told.count(kept->buffer) == 0 && stage.told.count(next->buffer) == 1));
  CHECK(stage.budget->used() == 25 * kPage);
  CHECK(memory->bytes()[0] == std::byte(0));  // whoever has it may look
}

TEST_CASE("arenas: one that the client unmapped ends, or comes again for what is on its way") {
  Stage stage;
  const auto first = stage.sent(100'000);
  CHECK_FALSE(stage.frames->unmapped(first->buffer));
  CHECK(stage.announced == 2);
  for (int i = 0; i < 9; ++i) CHECK_FALSE(stage.frames->unmapped(first->buffer));
  CHECK(stage.announced == 2);
  CHECK(stage.sent(100'000)->buffer != first->buffer);
  stage.give_back(*first);
  CHECK(stage.told.count(first->buffer) == 0);
  CHECK_FALSE(stage.frames->unmapped(first->buffer));
  CHECK_FALSE(stage.frames->unmapped(99));
}

TEST_CASE(
    "arenas: a client that loses every other frame gets no descriptor for each that it keeps") {
  Stage stage(64 * kMiB);
  u64 given = 0;
  for (int i = 0; i < 1000; ++i) {
    if (!stage.sent(10'000)) continue;
    ++given;
    if (const auto lost = stage.sent(10'000)) stage.frames->give_up(lost->generation);
  }
  CHECK((given < 100 && stage.told.size() <= 34));
}

TEST_CASE("arenas: their numbers are those of no device's buffer, their generations of one use") {
  Stage stage;
  const auto lease = stage.sent(1000);
  stage.frames->give_back(lease->buffer + 1, lease->generation);
  stage.frames->give_back(lease->buffer, lease->generation + 1);
  stage.frames->give_up(lease->buffer + 1000);
  CHECK(stage.frames->used().second == 1);
  CHECK((::fcntl(lease->memory->fd(), F_GET_SEALS) & F_SEAL_FUTURE_WRITE) != 0);
}

TEST_CASE("arenas: each takes a descriptor of the tenant's, for as long as it lives") {
  Stage stage(4096 * kMiB, 4096 * kMiB, 2);
  std::vector<Lease> held;
  while (auto lease = stage.sent(kMiB / 4)) held.push_back(*lease);
  CHECK(stage.announced == 2);
  CHECK(stage.descriptors->used() == 2);
}
