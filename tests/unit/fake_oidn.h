// What a test sees of fake_oidn.cpp, and tells it.
#pragma once

/// Exported as fake_oidn_state.
struct FakeOidn {
  bool has_gpu = true, denoises = true;
  const char* start_error = nullptr;   // of oidnCommitDevice
  const char* filter_error = nullptr;  // of the next oidnCommitFilter
  int index = -1;                      // of the GPU that was opened
  const void* stream = nullptr;
  int devices = 0, filters = 0;  // alive
  int made = 0, executed = 0;    // filters made, pictures filtered
  const char* misuse = nullptr;  // of the interface: the first
};
