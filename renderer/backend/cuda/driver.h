// The CUDA driver, found at run time: one binary starts with and without a GPU. Declared by hand,
// as it is versioned by its symbols and needs no header.
#pragma once

#include <memory>
#include <string>

#include "renderer/base/error.h"
#include "renderer/base/types.h"

namespace heliograph::cuda {

using Result = int;  // 0: success
using Device = int;
using DevicePointer = u64;
using ContextHandle = struct ContextTag*;
using StreamHandle = struct StreamTag*;
using ModuleHandle = struct ModuleTag*;
using FunctionHandle = struct FunctionTag*;
using PoolHandle = struct PoolTag*;
using EventHandle = struct EventTag*;
using MemoryHandle = u64;  // of physical memory

/// CUmemLocation, CUmemAllocationProp and CUmemAccessDesc.
struct MemoryLocation {
  int kind;
  int id;
};
struct AllocationProperties {
  int kind;
  int handle_kinds;
  MemoryLocation location;
  void* windows = nullptr;
  u64 flags = 0;
};
static_assert(sizeof(AllocationProperties) == 32);
struct AccessDescription {
  MemoryLocation location;
  int access;
};

// name of the member, symbol, arguments
#define HELIO_CUDA_FUNCTIONS(F)                                                                   \
  F(init, cuInit, unsigned)                                                                       \
  F(error_name, cuGetErrorName, Result, const char**)                                             \
  F(error_text, cuGetErrorString, Result, const char**)                                           \
  F(device_count, cuDeviceGetCount, int*)                                                         \
  F(device_at, cuDeviceGet, Device*, int)                                                         \
  F(device_name, cuDeviceGetName, char*, int, Device)                                             \
  F(device_attribute, cuDeviceGetAttribute, int*, int, Device)                                    \
  F(create_context, cuCtxCreate_v2, ContextHandle*, unsigned, Device)                             \
  F(destroy_context, cuCtxDestroy_v2, ContextHandle)                                              \
  F(primary_state, cuDevicePrimaryCtxGetState, Device, unsigned*, int*)                           \
  F(retain_primary, cuDevicePrimaryCtxRetain, ContextHandle*, Device)                             \
  F(release_primary, cuDevicePrimaryCtxRelease_v2, Device)                                        \
  F(reset_primary, cuDevicePrimaryCtxReset_v2, Device)                                            \
  F(set_context, cuCtxSetCurrent, ContextHandle)                                                  \
  F(wait_for_context, cuCtxSynchronize)                                                           \
  F(memory_info, cuMemGetInfo_v2, std::size_t*, std::size_t*)                                     \
  F(default_pool, cuDeviceGetDefaultMemPool, PoolHandle*, Device)                                 \
  F(set_pool, cuMemPoolSetAttribute, PoolHandle, int, void*)                                      \
  F(pool_value, cuMemPoolGetAttribute, PoolHandle, int, void*)                                    \
  F(trim_pool, cuMemPoolTrimTo, PoolHandle, std::size_t)                                          \
  F(allocate, cuMemAllocAsync, DevicePointer*, std::size_t, StreamHandle)                         \
  F(release, cuMemFreeAsync, DevicePointer, StreamHandle)                                         \
  F(allocate_pinned, cuMemHostAlloc, void**, std::size_t, unsigned)                               \
  F(release_pinned, cuMemFreeHost, void*)                                                         \
  F(pin, cuMemHostRegister_v2, void*, std::size_t, unsigned)                                      \
  F(unpin, cuMemHostUnregister, void*)                                                            \
  F(pinned_at, cuMemHostGetDevicePointer_v2, DevicePointer*, void*, unsigned)                     \
  F(upload, cuMemcpyHtoDAsync_v2, DevicePointer, const void*, std::size_t, StreamHandle)          \
  F(download, cuMemcpyDtoHAsync_v2, void*, DevicePointer, std::size_t, StreamHandle)              \
  F(copy, cuMemcpyDtoDAsync_v2, DevicePointer, DevicePointer, std::size_t, StreamHandle)          \
  F(fill, cuMemsetD8Async, DevicePointer, unsigned char, std::size_t, StreamHandle)               \
  F(create_stream, cuStreamCreate, StreamHandle*, unsigned)                                       \
  F(destroy_stream, cuStreamDestroy_v2, StreamHandle)                                             \
  F(wait_for_stream, cuStreamSynchronize, StreamHandle)                                           \
  F(let_stream_wait, cuStreamWaitEvent, StreamHandle, EventHandle, unsigned)                      \
  F(create_event, cuEventCreate, EventHandle*, unsigned)                                          \
  F(destroy_event, cuEventDestroy_v2, EventHandle)                                                \
  F(record_event, cuEventRecord, EventHandle, StreamHandle)                                       \
  F(wait_for_event, cuEventSynchronize, EventHandle)                                              \
  F(load_module, cuModuleLoadFatBinary, ModuleHandle*, const void*)                               \
  F(unload_module, cuModuleUnload, ModuleHandle)                                                  \
  F(function_in, cuModuleGetFunction, FunctionHandle*, ModuleHandle, const char*)                 \
  F(function_attribute, cuFuncGetAttribute, int*, int, FunctionHandle)                            \
  F(blocks_per_processor, cuOccupancyMaxActiveBlocksPerMultiprocessor, int*, FunctionHandle, int, \
    std::size_t)                                                                                  \
  F(device_uuid, cuDeviceGetUuid_v2, void*, Device)                                               \
  F(granularity, cuMemGetAllocationGranularity, std::size_t*, const AllocationProperties*, int)   \
  F(create_memory, cuMemCreate, MemoryHandle*, std::size_t, const AllocationProperties*, u64)     \
  F(release_memory, cuMemRelease, MemoryHandle)                                                   \
  F(export_memory, cuMemExportToShareableHandle, void*, MemoryHandle, int, u64)                   \
  F(reserve, cuMemAddressReserve, DevicePointer*, std::size_t, std::size_t, DevicePointer, u64)   \
  F(unreserve, cuMemAddressFree, DevicePointer, std::size_t)                                      \
  F(map, cuMemMap, DevicePointer, std::size_t, std::size_t, MemoryHandle, u64)                    \
  F(unmap, cuMemUnmap, DevicePointer, std::size_t)                                                \
  F(access, cuMemSetAccess, DevicePointer, std::size_t, const AccessDescription*, std::size_t)    \
  F(launch, cuLaunchKernel, FunctionHandle, unsigned, unsigned, unsigned, unsigned, unsigned,     \
    unsigned, unsigned, StreamHandle, void**, void**)

/// Owns: the library. Thread: any.
struct Driver {
#define HELIO_MEMBER(name, symbol, ...) Result (*name)(__VA_ARGS__) = nullptr;
  HELIO_CUDA_FUNCTIONS(HELIO_MEMBER)
#undef HELIO_MEMBER
  std::shared_ptr<void> library;

  /// "CUDA_ERROR_OUT_OF_MEMORY: out of memory".
  [[nodiscard]] std::string describe(Result result) const;
};

/// True if the driver answers with this for as long as the process lives, in every context, those
/// that are made after it too.
///
/// Source: cuda.h (13.0), CUresult: "leaves the process in an inconsistent state and any further
/// CUDA work will return the same error"; and what memory and links cannot correct.
[[nodiscard]] bool is_sticky(Result result);

/// Fails with UNAVAILABLE where there is no driver, or one that lacks a function;
/// FAILED_PRECONDITION after an error that is_sticky().
[[nodiscard]] Expected<Driver> load_driver();

/// cuFuncGetAttribute's number of the threads that a program's block has at most.
inline constexpr int kMostThreads = 0;

/// cuDeviceGetAttribute's numbers.
enum class Attribute : int {
  kProcessors = 16,
  kMajor = 75,
  kMinor = 76,
  kVirtualMemory = 102,
  kDescriptors = 103,
};

}  // namespace heliograph::cuda
