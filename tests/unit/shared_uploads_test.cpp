// Arrays in a client's own memory: mapped, not copied, and never changed after the check.
#include <fcntl.h>
#include <sys/mman.h>

#include "server/os/unique_fd.h"
#include "server/store/used_uploads.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

constexpr int kSeals = F_SEAL_WRITE | F_SEAL_SHRINK | F_SEAL_GROW;
const std::string kText(200, 'a');

UniqueFd memory(int seals) {
  UniqueFd fd(::memfd_create("test", MFD_CLOEXEC | MFD_ALLOW_SEALING));
  REQUIRE(::write(fd.get(), kText.data(), kText.size()) == ssize_t(kText.size()));
  REQUIRE(::fcntl(fd.get(), F_ADD_SEALS, seals) == 0);
  return fd;
}

std::shared_ptr<Budget> room(u64 bytes) {
  return std::make_shared<Budget>(bytes,
                                  Budget::RefusalText{"bytes", "remove some", "tenant_bytes"});
}

v1::BufferRef ref(u64 buffer, u64 size, u64 offset = 0) {
  v1::BufferRef made;
  made.set_buffer(buffer);
  made.set_size(size);
  made.set_offset(offset);
  return made;
}

void refused(const Expected<BufferPtr>& used, Code code, const std::string& where) {
  REQUIRE(!used);
  INFO(used.error().where << ": " << used.error().message);
  CHECK(int(used.error().code) == int(code));
  CHECK(used.error().where == where);
}

}  // namespace

TEST_CASE("shared uploads: the bytes are those of the memory, and count until nobody has them") {
  const auto budget = room(1000);
  SharedUploads uploads(budget);
  uploads.take(5, kText.size(), memory(kSeals).get());
  CHECK(budget->used() == kText.size());
  auto used = uploads.use(ref(5, 100, 64));
  REQUIRE(used);
  CHECK((*used)->bytes().size() == 100);
  CHECK((*used)->bytes()[99] == std::byte('a'));
  refused(uploads.use(ref(5, 100)), Code::kNotFound, "buffer.buffer");
  used = nullptr;
  CHECK(budget->used() == 0);
}

TEST_CASE("shared uploads: what was not used after all is there for the same reference") {
  const auto budget = room(1000);
  BlobStore blobs({.recent = {.seconds = 0}});
  AssetStore assets;
  SessionArrays arrays(blobs, assets, budget);
  const auto array = [](const v1::BufferRef& named) {
    v1::Array made;
    *made.mutable_buffer() = named;
    return made;
  };
  const v1::Array part = array(ref(5, 100, 64));
  const auto use_and_give_back = [&] {
    UsedUploads uses(arrays);
    REQUIRE(uses.bytes(part));
    uses.give_back(Error{.code = Code::kNotFound, .message = "", .where = ""});
  };
  arrays.shared().take(5, kText.size(), memory(kSeals).get());
  use_and_give_back();
  CHECK(budget->used() == kText.size());
  refused(arrays.bytes(array(ref(5, 100))), Code::kNotFound, "buffer.buffer");
  use_and_give_back();
  CHECK((*arrays.bytes(part))->bytes().size() == 100);
  refused(arrays.bytes(part), Code::kNotFound, "buffer.buffer");
  CHECK(budget->used() == 0);

  arrays.shared().take(5, kText.size(), memory(kSeals).get());
  use_and_give_back();
  arrays.sweep();
  CHECK(budget->used() == 0);

  arrays.shared().take(5, kText.size(), memory(kSeals).get());
  UsedUploads uses(arrays);
  REQUIRE(uses.bytes(part));
  uses.give_back(Error{.code = Code::kInvalidArgument, .message = "", .where = ""});
  CHECK_FALSE(arrays.bytes(part));
}

TEST_CASE("shared uploads: what waits in the socket is heard first") {
  SharedUploads uploads(room(1000));
  uploads.set_poll([&] { uploads.take(8, kText.size(), memory(kSeals).get()); });
  CHECK(uploads.use(ref(8, kText.size())));
}

TEST_CASE("shared uploads: what is wrong is told to the request that names it") {
  SharedUploads uploads(room(300));
  for (const int missing : {F_SEAL_WRITE, F_SEAL_SHRINK, F_SEAL_GROW}) {
    uploads.take(1, kText.size(), memory(kSeals & ~missing).get());
    refused(uploads.use(ref(1, 8)), Code::kInvalidArgument, "buffer.buffer");
  }
  uploads.take(1, 4096, memory(kSeals).get());
  refused(uploads.use(ref(1, 8)), Code::kInvalidArgument, "buffer.buffer");
  uploads.take(1, 0, UniqueFd(::open("/dev/null", O_RDONLY)).get());
  refused(uploads.use(ref(1, 8)), Code::kInvalidArgument, "buffer.buffer");
  for (const auto& [offset, size] : {std::pair{0ul, 201ul}, {64, 137}, {256, 0}, {~63ul, 64}}) {
    uploads.take(1, kText.size(), memory(kSeals).get());
    refused(uploads.use(ref(1, size, offset)), Code::kInvalidArgument, "buffer.size");
  }
  uploads.take(1, kText.size(), memory(kSeals).get());
  refused(uploads.use(ref(1, 8, 8)), Code::kInvalidArgument, "buffer.offset");
  uploads.take(1, kText.size(), memory(kSeals).get());
  uploads.take(2, kText.size(), memory(kSeals).get());
  refused(uploads.use(ref(2, 8)), Code::kResourceExhausted, "");
}

TEST_CASE("shared uploads: what was lent is named again and again") {
  SharedUploads uploads(room(1 << 20));
  v1::BufferRef lent = ref(7, 3);
  lent.set_generation(5);
  refused(uploads.use(lent), Code::kNotFound, "buffer.buffer");
  const auto bytes = std::as_bytes(std::span(kText)).first(3);
  const auto take = [&](u64, std::span<const std::byte> piece) {
    CHECK(std::ranges::equal(piece, bytes));
  };
  CHECK(uploads.read_lent(lent, take) == false);  // nobody lends
  int reads = 0;
  const auto is_it = [&](const v1::BufferRef& named) {
    CHECK((named.buffer() == 7 && named.generation() == 5));
    ++reads;
  };
  uploads.lend({.copy = [&](const v1::BufferRef& named) -> Expected<BufferPtr> {
                  is_it(named);
                  return std::make_shared<const Buffer>(nullptr, bytes);
                },
                .read = [&](const v1::BufferRef& named, const TakePiece& to) -> Status {
                  is_it(named);
                  to(0, bytes);
                  return {};
                }});
  CHECK(uploads.use(lent));
  CHECK(uploads.use(lent));
  CHECK(uploads.read_lent(lent, take) == true);
  CHECK(uploads.read_lent(ref(7, 3), take) == false);
  CHECK(reads == 3);
  refused(uploads.use(ref(7, 3)), Code::kNotFound, "buffer.buffer");  // an upload is no such one
}
