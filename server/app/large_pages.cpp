#include "server/app/large_pages.h"

#include <jemalloc/jemalloc.h>
#include <sys/mman.h>

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <string>

#pragma weak mallctl  // the sanitizers' heap has none

namespace heliograph::server {
namespace {

constexpr std::size_t kLarge = 2 << 20;  // as oversize_threshold of malloc_conf

/// jemalloc's own, but for new memory.
struct Hooks : extent_hooks_t {
  extent_hooks_t* own = nullptr;
};

void* allocate(extent_hooks_t* hooks, void* at, std::size_t size, std::size_t alignment,
               bool* zeroed, bool* committed, unsigned arena) {
  extent_hooks_t* own = static_cast<Hooks*>(hooks)->own;
  void* extent = own->alloc(own, at, size, alignment, zeroed, committed, arena);
  if (extent) (void)::madvise(extent, size, MADV_HUGEPAGE);
  return extent;
}

}  // namespace

void use_large_pages() {
  if (!mallctl) return;
  const std::unique_ptr<void, decltype(&std::free)> large(std::malloc(kLarge), &std::free);
  void* address = large.get();
  unsigned arena = 0;
  std::size_t size = sizeof(arena);
  if (mallctl("arenas.lookup", &arena, &size, &address, sizeof(address)) != 0) return;
  const std::string name = "arena." + std::to_string(arena) + ".extent_hooks";
  static Hooks hooks;  // jemalloc keeps its address
  size = sizeof(void*);
  if (mallctl(name.c_str(), static_cast<void*>(&hooks.own), &size, nullptr, 0) != 0) return;
  static_cast<extent_hooks_t&>(hooks) = *hooks.own;
  hooks.alloc = allocate;
  extent_hooks_t* given = &hooks;
  (void)mallctl(name.c_str(), nullptr, nullptr, static_cast<void*>(&given), size);
}

}  // namespace heliograph::server
