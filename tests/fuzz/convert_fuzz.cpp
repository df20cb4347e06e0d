// The libFuzzer target of the code between the wire and the engine. Built by tests/fuzz/run.
#include <google/protobuf/stubs/logging.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "tests/fuzz/attempt.h"
#include "tests/fuzz/mutate.h"

using namespace heliograph;

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t most);

/// Protocol Buffers says of each input that is none why; nobody reads that.
extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** /*argv*/) {
  google::protobuf::SetLogHandler(nullptr);
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto message = fuzz::parse({reinterpret_cast<const char*>(data), size});
  if (!message) return -1;
  const std::string fault = fuzz::attempt(*message);
  if (fault.empty()) return 0;
  std::fprintf(stderr, "%s\n%s\n", fault.c_str(), message->DebugString().substr(0, 4000).c_str());
  std::abort();
}

/// Mostly one field changed somewhere, sometimes bytes.
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t most, unsigned seed) {
  fuzz::Random random(seed);
  const auto message = fuzz::parse({reinterpret_cast<const char*>(data), size});
  if (!message || random() % 16 == 0) {
    if (size == 0) return LLVMFuzzerMutate(data, size, most);
    const std::size_t rest = LLVMFuzzerMutate(data + 1, size - 1, most - 1);
    data[0] = std::uint8_t("trqk"[random() % 4]);
    return rest + 1;
  }
  for (u64 n = 1 + random() % 3; n > 0; --n) fuzz::mutate(*message, random);
  const std::string out = message->SerializeAsString();
  if (out.size() + 1 > most) return size;
  std::memcpy(data + 1, out.data(), out.size());
  return out.size() + 1;
}
