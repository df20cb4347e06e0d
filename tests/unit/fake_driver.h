// A CUDA driver whose device is the host's memory, for tests of what the backend asks of it. It
// runs no programs.
#pragma once

#include <cstdlib>
#include <cstring>

#include "renderer/backend/cuda/driver.h"

namespace heliograph::test {

/// Allocations that are not freed yet.
inline u64 fake_allocations = 0;
/// What the pool keeps: bytes that were asked for, until it is trimmed.
inline u64 fake_reserved = 0;
inline u64 fake_trims = 0;
/// Allocations that are out of memory from now on.
inline u64 fake_failures = 0;

inline cuda::Driver fake_driver() {
  using namespace cuda;
  Driver d;
  d.device_count = [](int* count) { return *count = 1, 0; };
  d.device_at = [](Device* device, int index) { return *device = index, 0; };
  d.device_name = [](char*, int, Device) { return 0; };
  d.device_attribute = [](int* value, int, Device) { return *value = 1, 0; };
  static int one;
  d.create_context = [](ContextHandle* context, unsigned, Device) {
    return *context = reinterpret_cast<ContextHandle>(&one), 0;
  };
  d.destroy_context = [](ContextHandle) { return 0; };
  d.primary_state = [](Device, unsigned*, int* is_taken) { return *is_taken = 0, 0; };
  d.retain_primary = [](ContextHandle* context, Device) {
    return *context = reinterpret_cast<ContextHandle>(&one), 0;
  };
  d.release_primary = [](Device) { return 0; };
  d.reset_primary = [](Device) { return 0; };
  d.wait_for_context = [] { return 0; };
  d.set_context = [](ContextHandle) { return 0; };
  d.memory_info = [](std::size_t* free, std::size_t* all) { return *free = *all = 1u << 30, 0; };
  d.default_pool = [](PoolHandle*, Device) { return 0; };
  d.set_pool = [](PoolHandle, int, void*) { return 0; };
  d.trim_pool = [](PoolHandle, std::size_t) {
    ++fake_trims;
    return Result(fake_reserved = 0);
  };
  d.pool_value = [](PoolHandle, int which, void* value) {
    *static_cast<u64*>(value) = fake_reserved;
    return Result(which != 5);
  };
  d.allocate = [](DevicePointer* at, std::size_t bytes, StreamHandle) {
    if (fake_failures > 0) {
      --fake_failures;
      return 2;
    }
    ++fake_allocations;
    fake_reserved += bytes;
    return *at = DevicePointer(std::malloc(bytes)), 0;
  };
  d.release = [](DevicePointer at, StreamHandle) {
    --fake_allocations;
    return std::free(reinterpret_cast<void*>(at)), 0;
  };
  d.upload = [](DevicePointer to, const void* from, std::size_t bytes, StreamHandle) {
    return std::memcpy(reinterpret_cast<void*>(to), from, bytes), 0;
  };
  d.download = [](void* to, DevicePointer from, std::size_t bytes, StreamHandle) {
    return std::memcpy(to, reinterpret_cast<const void*>(from), bytes), 0;
  };
  d.copy = [](DevicePointer to, DevicePointer from, std::size_t bytes, StreamHandle) {
    return std::memcpy(reinterpret_cast<void*>(to), reinterpret_cast<const void*>(from), bytes), 0;
  };
  d.fill = [](DevicePointer at, unsigned char byte, std::size_t bytes, StreamHandle) {
    return std::memset(reinterpret_cast<void*>(at), byte, bytes), 0;
  };
  d.allocate_pinned = [](void** at, std::size_t bytes, unsigned) {
    return *at = std::malloc(bytes), 0;
  };
  d.release_pinned = [](void* at) { return std::free(at), 0; };
  d.pin = [](void*, std::size_t, unsigned) { return 0; };
  d.unpin = [](void*) { return 0; };
  d.pinned_at = [](DevicePointer* at, void* host, unsigned) {
    return *at = DevicePointer(host), 0;
  };
  d.let_stream_wait = [](StreamHandle, EventHandle, unsigned) { return 0; };
  d.create_event = [](EventHandle*, unsigned) { return 0; };
  d.destroy_event = [](EventHandle) { return 0; };
  d.record_event = [](EventHandle, StreamHandle) { return 0; };
  d.wait_for_event = [](EventHandle) { return 0; };
  d.create_stream = [](StreamHandle*, unsigned) { return 0; };
  d.destroy_stream = [](StreamHandle) { return 0; };
  d.wait_for_stream = [](StreamHandle) { return 0; };
  d.load_module = [](ModuleHandle*, const void*) { return 0; };
  d.unload_module = [](ModuleHandle) { return 0; };
  return d;
}

}  // namespace heliograph::test
