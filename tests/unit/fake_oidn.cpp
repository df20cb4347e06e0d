// Open Image Denoise's C interface over a filter that makes twice the albedo of a picture. It
// checks what the library would: formats, strides, and that a filter is committed before it is
// executed.
#include "tests/unit/fake_oidn.h"

#include <cstddef>
#include <cstring>
#include <list>
#include <map>
#include <string>

namespace {

struct Image {
  float* pixels;
  std::size_t width, height, stride;
};
struct Device {
  const char* error = nullptr;
};
struct Filter {
  Device* device;
  std::map<std::string, Image> images;
  bool is_hdr = false, is_committed = false;
};
const char* error_without_device = nullptr;

// What was made and not released, also by who abandons it.
std::list<Device> devices_there;
std::list<Filter> filters_there;

}  // namespace

// NOLINTBEGIN(readability-identifier-naming): the library's names
extern "C" {
FakeOidn fake_oidn_state;

static void must(bool holds, const char* what) {
  if (!holds && !fake_oidn_state.misuse) fake_oidn_state.misuse = what;
}

Device* oidnNewDevice(int kind) {
  must(kind == 1, "only the CPU is opened by its kind");
  ++fake_oidn_state.devices;
  return &devices_there.emplace_back();
}
Device* oidnNewCUDADevice(const int* devices, void* const* streams, int pairs) {
  must(pairs == 1, "one GPU");
  if (!fake_oidn_state.has_gpu) {
    error_without_device = "unsupported device type";
    return nullptr;
  }
  fake_oidn_state.index = devices[0];
  fake_oidn_state.stream = streams[0];
  ++fake_oidn_state.devices;
  return &devices_there.emplace_back();
}
void oidnReleaseDevice(Device* device) {
  --fake_oidn_state.devices;
  devices_there.remove_if([=](const Device& one) { return &one == device; });
}
void oidnSetDeviceInt(Device*, const char*, int) {}
int oidnGetDeviceInt(Device*, const char* name) {
  must(std::strcmp(name, "version") == 0, "the version is asked for");
  return 20501;
}
void oidnCommitDevice(Device* device) { device->error = fake_oidn_state.start_error; }
int oidnGetDeviceError(Device* device, const char** text) {
  const char*& error = device ? device->error : error_without_device;
  *text = error;
  error = nullptr;
  return *text ? 1 : 0;
}
Filter* oidnNewFilter(Device* device, const char* kind) {
  must(std::strcmp(kind, "RT") == 0, "the filter for ray tracing");
  ++fake_oidn_state.filters;
  ++fake_oidn_state.made;
  return &filters_there.emplace_back(Filter{.device = device, .images = {}});
}
void oidnReleaseFilter(Filter* filter) {
  --fake_oidn_state.filters;
  filters_there.remove_if([=](const Filter& one) { return &one == filter; });
}
void oidnSetSharedFilterImage(Filter* filter, const char* name, void* pixels, int format,
                              std::size_t width, std::size_t height, std::size_t offset,
                              std::size_t pixel_stride, std::size_t row_stride) {
  must(format == 3 && offset == 0 && row_stride == 0, "three floats a pixel, rows without gaps");
  filter->images[name] = {static_cast<float*>(pixels), width, height, pixel_stride / sizeof(float)};
  filter->is_committed = false;
}
void oidnSetFilterBool(Filter* filter, const char* name, bool value) {
  filter->is_hdr = std::strcmp(name, "hdr") == 0 && value;
  filter->is_committed = false;
}
void oidnSetFilterProgressMonitorFunction(Filter*, bool (*)(void*, double), void*) {}
void oidnCommitFilter(Filter* filter) {
  filter->device->error = fake_oidn_state.filter_error;
  filter->is_committed = !fake_oidn_state.filter_error;
  fake_oidn_state.filter_error = nullptr;
}
void oidnExecuteFilter(Filter* filter) {
  must(filter->is_hdr && filter->is_committed && filter->images.size() == 4, "all is set");
  const Image &albedo = filter->images["albedo"], &out = filter->images["output"];
  must(filter->images["color"].stride == 4 && out.stride == 4, "beauty has an alpha");
  must(albedo.stride == 3 && filter->images["normal"].stride == 3, "guides have none");
  ++fake_oidn_state.executed;
  if (!fake_oidn_state.denoises) return;
  for (std::size_t i = 0; i < out.width * out.height; ++i)
    for (int c = 0; c < 3; ++c) out.pixels[4 * i + c] = 2 * albedo.pixels[3 * i + c];
}
void oidnExecuteFilterAsync(Filter* filter) { oidnExecuteFilter(filter); }
}
// NOLINTEND(readability-identifier-naming)
