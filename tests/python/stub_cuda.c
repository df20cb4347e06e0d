// A libcuda without a GPU: device memory is the memory behind a descriptor, mapped as it is, and
// work is in flight while the test says so. Compiled and loaded by tests/python/stub_cuda.py.
#include <stdint.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

typedef unsigned long long u64;

enum { kInvalid = 1, kNotReady = 600, kCapturing = 900, kHandles = 4096 };

// What the test sets and counts.
int stub_busy = 0;       // work is in flight
int stub_capturing = 0;  // a stream is captured into a graph
int stub_refuses = 0;    // cuMemMap fails
int stub_devices = 2;
int stub_handles = 0, stub_ranges = 0, stub_mapped = 0, stub_events = 0;
int stub_early = 0;   // unmapped while work was in flight
int stub_stream = 0;  // of the last copy
int stub_depth = 0;   // contexts pushed and not popped

static const unsigned char kUuid[16] = {'h', 'e', 'l', 'i', 'o', 'g', 'r', 'a',
                                        'p', 'h', 0,   1,   2,   3,   4,   5};

int cuInit(unsigned flags) { return flags != 0; }
int cuDeviceGetCount(int* count) { return *count = stub_devices, 0; }
int cuDeviceGet(int* device, int number) { return *device = number, 0; }
int cuDeviceGetUuid_v2(void* uuid, int device) {
  memcpy(uuid, kUuid, 16);
  if (device == 0) memset(uuid, 0xee, 16);  // the daemon's GPU is number 1 here
  return 0;
}
int cuDevicePrimaryCtxRetain(void** context, int device) {
  return *context = (void*)(uintptr_t)(device + 1), 0;
}
int cuCtxPushCurrent_v2(void* context) {
  return context != (void*)2 ? kInvalid : (++stub_depth, 0);
}
int cuCtxPopCurrent_v2(void** context) { return *context = 0, --stub_depth, 0; }
int cuCtxSynchronize(void) { return stub_depth > 0 ? (stub_busy = 0) : kInvalid; }
int cuThreadExchangeStreamCaptureMode(int* mode) { return *mode = *mode == 2 ? 0 : 2, 0; }

int cuEventCreate(void** event, unsigned flags) {
  return *event = (void*)(uintptr_t)++stub_events, flags != 2;
}
int cuCtxRecordEvent(void* context, void* event) {
  return context && event && !stub_capturing ? 0 : kCapturing;
}
int cuEventQuery(void* event) { return event && stub_busy ? kNotReady : 0; }
int cuEventDestroy_v2(void* event) { return event ? (--stub_events, 0) : kInvalid; }

int cuMemImportFromShareableHandle(u64* handle, void* descriptor, int kind) {
  *handle = (u64)dup((int)(intptr_t)descriptor);
  return kind != 1 || *handle >= kHandles ? kInvalid : (++stub_handles, 0);
}
int cuMemRelease(u64 handle) { return --stub_handles, close((int)handle); }
int cuMemAddressReserve(u64* at, size_t bytes, size_t aligned, u64 wanted, u64 flags) {
  void* start = mmap(0, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  *at = (u64)start;
  return start == MAP_FAILED || aligned || wanted || flags ? kInvalid : (++stub_ranges, 0);
}
int cuMemAddressFree(u64 at, size_t bytes) { return --stub_ranges, munmap((void*)at, bytes); }
int cuMemMap(u64 at, size_t bytes, size_t offset, u64 handle, u64 flags) {
  struct stat file;
  if (stub_refuses || offset || flags || fstat((int)handle, &file) != 0) return kInvalid;
  if ((size_t)file.st_size != bytes) return kInvalid;
  void* start =
      mmap((void*)at, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_FIXED, (int)handle, 0);
  return start == MAP_FAILED ? kInvalid : (++stub_mapped, 0);
}
int cuMemUnmap(u64 at, size_t bytes) {
  stub_early += stub_busy;
  --stub_mapped;
  return mmap((void*)at, bytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_FIXED, -1, 0) ==
         MAP_FAILED;
}
int cuMemSetAccess(u64 at, size_t bytes, const int* access, size_t count) {
  return at && bytes && count == 1 && access[0] == 1 && access[1] == 1 && access[2] == 3 ? 0
                                                                                         : kInvalid;
}
int cuMemcpyDtoDAsync_v2(u64 to, u64 from, size_t bytes, void* stream) {
  stub_stream = (int)(intptr_t)stream;
  return stub_depth > 0 ? (memcpy((void*)to, (void*)from, bytes), 0) : kInvalid;
}
int cuStreamSynchronize(void* stream) { return stub_stream != (int)(intptr_t)stream; }
int cuMemcpyDtoH_v2(void* to, u64 from, size_t bytes) {
  return stub_depth > 0 ? (memcpy(to, (void*)from, bytes), 0) : kInvalid;
}
