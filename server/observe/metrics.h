// Metrics for Prometheus. Updated by the call log, the render tasks, decoding and the accept loop;
// read by the metrics port.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "renderer/schedule/engine.h"

namespace heliograph::server {

/// A gauge, computed at each scrape.
struct MetricValue {
  std::string name;
  std::string help;
  double value = 0;
  std::map<std::string, std::string> labels{};
  bool is_counter = false;
};

/// Owns: the counters. Thread: any; an observation takes at most 1 us, and none is made in the
/// pixel loop. Label values are bounded: methods of the protocol, status codes, tenants.
class Metrics {
 public:
  Metrics();
  ~Metrics();

  struct CallEnd {
    std::string_view method;  // "/heliograph.v1.Renderer/Apply"
    int code = 0;             // gRPC status code
    double seconds = 0;
    u64 received_bytes = 0, sent_bytes = 0;
  };
  void call(const CallEnd& end);
  void job(const std::string& tenant, const Status& status, const Spent& spent);
  void decode(const Status& status);
  void connection_refused();
  void identity_refused();

  /// Returns the counters and `values` in Prometheus' text format.
  [[nodiscard]] std::string text(const std::vector<MetricValue>& values) const;

 private:
  struct Families;
  std::unique_ptr<Families> families_;
};

/// Returns the name of a status code as gRPC spells it, such as "RESOURCE_EXHAUSTED".
[[nodiscard]] std::string_view code_name(int code);

}  // namespace heliograph::server
