// Several arrays in one piece of device memory.
#pragma once

#include "renderer/backend/cuda/driver.h"

namespace heliograph::cuda {

/// Lays arrays out one after the other, and knows what they need together.
class Layout {
 public:
  explicit Layout(DevicePointer from) : from_(from) {}
  template <class T>
  T* take(u64 count) {
    bytes_ = (bytes_ + kAlignment - 1) / kAlignment * kAlignment;
    const DevicePointer at = from_ + bytes_;
    bytes_ += count * sizeof(T);
    return reinterpret_cast<T*>(at);
  }
  [[nodiscard]] DevicePointer end() const { return from_ + bytes_; }
  [[nodiscard]] u64 bytes() const { return bytes_; }

 private:
  static constexpr u64 kAlignment = 128;
  DevicePointer from_;
  u64 bytes_ = 0;
};

}  // namespace heliograph::cuda
