// See sealed_memory.h.
#include "server/store/sealed_memory.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

namespace heliograph::server {

std::shared_ptr<SealedMemory> SealedMemory::create(u64 bytes) {
  UniqueFd fd(::memfd_create("heliograph-frame", MFD_CLOEXEC | MFD_ALLOW_SEALING));
  if (fd.get() < 0 || ::ftruncate(fd.get(), off_t(bytes)) != 0) return nullptr;
  void* start = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd.get(), 0);
  if (start == MAP_FAILED) return nullptr;
  std::shared_ptr<SealedMemory> made(
      new SealedMemory(std::move(fd), {static_cast<std::byte*>(start), bytes}));
  constexpr int kSeals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL;
  return ::fcntl(made->fd(), F_ADD_SEALS, kSeals) == 0 ? std::move(made) : nullptr;
}

SealedMemory::~SealedMemory() { ::munmap(bytes_.data(), bytes_.size()); }

}  // namespace heliograph::server
