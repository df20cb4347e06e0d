// Counters and histograms through prometheus-cpp's core library. See metrics.h.
#include "server/observe/metrics.h"

#include <prometheus/counter.h>
#include <prometheus/histogram.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <array>
#include <mutex>

namespace heliograph::server {
namespace {

using prometheus::Counter;
using prometheus::Family;
using prometheus::Histogram;
using prometheus::Registry;

constexpr std::array<std::string_view, 17> kCodes = {
    "OK",
    "CANCELLED",
    "UNKNOWN",
    "INVALID_ARGUMENT",
    "DEADLINE_EXCEEDED",
    "NOT_FOUND",
    "ALREADY_EXISTS",
    "PERMISSION_DENIED",
    "RESOURCE_EXHAUSTED",
    "FAILED_PRECONDITION",
    "ABORTED",
    "OUT_OF_RANGE",
    "UNIMPLEMENTED",
    "INTERNAL",
    "UNAVAILABLE",
    "DATA_LOSS",
    "UNAUTHENTICATED",
};

/// Bucket bounds in seconds: 10 us, less than an edit takes, to 5 min.
const Histogram::BucketBoundaries kSeconds = {1e-5, 3e-5, 1e-4, 3e-4, 0.001, 0.003, 0.01, 0.03,
                                              0.1,  0.3,  1,    3,    10,    30,    100,  300};

Family<Counter>& counter(Registry& registry, const std::string& name, const std::string& help) {
  return prometheus::BuildCounter().Name("heliograph_" + name).Help(help).Register(registry);
}
Family<Histogram>& histogram(Registry& registry, const std::string& name, const std::string& help) {
  return prometheus::BuildHistogram().Name("heliograph_" + name).Help(help).Register(registry);
}

int code_of(const Status& status) { return status ? 0 : int(status.error().code); }

/// Returns the index in kCodes; codes that gRPC does not define count as UNKNOWN.
std::size_t code_index(int code) {
  return code >= 0 && std::size_t(code) < kCodes.size() ? std::size_t(code) : 2;
}

/// "/heliograph.v1.Renderer/Apply" -> "Apply"; other services keep their names.
std::string short_method(std::string_view method) {
  constexpr std::string_view kOwn = "/heliograph.v1.Renderer/";
  return std::string(method.starts_with(kOwn) ? method.substr(kOwn.size()) : method.substr(1));
}

prometheus::MetricFamily family_of(const MetricValue& value) {
  const auto type =
      value.is_counter ? prometheus::MetricType::Counter : prometheus::MetricType::Gauge;
  return {.name = value.name, .help = value.help, .type = type, .metric = {}};
}

prometheus::ClientMetric metric_of(const MetricValue& value) {
  prometheus::ClientMetric metric;
  for (const auto& [name, label] : value.labels) metric.label.push_back({name, label});
  (value.is_counter ? metric.counter.value : metric.gauge.value) = value.value;
  return metric;
}

/// Metrics of one method or tenant, cached because the library's lookup by labels takes longer than
/// counting.
struct CallMetrics {
  std::array<Counter*, kCodes.size()> ended;
  Histogram* seconds;
  Counter *received_bytes, *sent_bytes;
};
struct JobMetrics {
  std::array<Counter*, kCodes.size()> ended;
  Counter *samples, *rays, *helper_seconds;
  Histogram *queue_seconds, *device_seconds;
};
template <class T>
using ByName = std::map<std::string, T, std::less<>>;

/// Makes a family's counters for every status code, with `labels`, so that codes that never
/// occurred export 0.
std::array<Counter*, kCodes.size()> by_code(Family<Counter>& family, prometheus::Labels labels) {
  std::array<Counter*, kCodes.size()> counters;
  for (std::size_t code = 0; code < kCodes.size(); ++code) {
    labels["code"] = kCodes[code];
    counters[code] = &family.Add(labels);
  }
  return counters;
}

}  // namespace

struct Metrics::Families {
  Registry registry;
  Family<Counter>& calls =
      counter(registry, "calls_total", "Calls that ended, by method and status code");
  Family<Counter>& received_bytes = counter(registry, "received_bytes_total",
                                            "Bytes of messages received from clients, by method");
  Family<Counter>& sent_bytes =
      counter(registry, "sent_bytes_total", "Bytes of messages sent to clients, by method");
  Family<Histogram>& call_seconds =
      histogram(registry, "call_seconds", "How long calls took, by method");
  Family<Counter>& jobs =
      counter(registry, "jobs_total", "Render jobs that ended, by tenant and status code");
  Family<Counter>& samples = counter(registry, "samples_total", "Samples of all pixels, by tenant");
  Family<Counter>& rays = counter(registry, "rays_total", "Rays traced, by tenant");
  Family<Counter>& helper_seconds =
      counter(registry, "helper_seconds_total",
              "How long idle devices helped the one that had a render job, by tenant");
  Family<Histogram>& queue_seconds = histogram(
      registry, "job_queue_seconds", "How long render jobs waited for the device, by tenant");
  Family<Histogram>& device_seconds =
      histogram(registry, "job_device_seconds", "How long render jobs had the device, by tenant");
  std::array<Counter*, kCodes.size()> decodes = by_code(
      counter(registry, "decodes_total", "Assets decoded, by status code; not OK is a failure"),
      {});
  Counter& refused_connections =
      counter(registry, "refused_connections_total", "Connections closed because too many are open")
          .Add({});

  Counter& refused_identities =
      counter(registry, "refused_identities_total",
              "Calls over TCP that ended before their message, for want of an identity")
          .Add({});

  std::mutex mutex;
  ByName<CallMetrics> methods;
  ByName<JobMetrics> tenants;

  CallMetrics& of_method(std::string_view method) {
    const std::lock_guard lock(mutex);
    const auto found = methods.find(method);
    if (found != methods.end()) return found->second;
    const prometheus::Labels labels = {{"method", short_method(method)}};
    return methods
        .emplace(method, CallMetrics{by_code(calls, labels), &call_seconds.Add(labels, kSeconds),
                                     &received_bytes.Add(labels), &sent_bytes.Add(labels)})
        .first->second;
  }

  JobMetrics& of_tenant(const std::string& tenant) {
    const std::lock_guard lock(mutex);
    const auto found = tenants.find(tenant);
    if (found != tenants.end()) return found->second;
    const prometheus::Labels labels = {{"tenant", tenant}};
    return tenants
        .emplace(tenant,
                 JobMetrics{by_code(jobs, labels), &samples.Add(labels), &rays.Add(labels),
                            &helper_seconds.Add(labels), &queue_seconds.Add(labels, kSeconds),
                            &device_seconds.Add(labels, kSeconds)})
        .first->second;
  }
};

Metrics::Metrics() : families_(std::make_unique<Families>()) {}
Metrics::~Metrics() = default;

void Metrics::call(const CallEnd& end) {
  const CallMetrics& metrics = families_->of_method(end.method);
  metrics.ended[code_index(end.code)]->Increment();
  metrics.seconds->Observe(end.seconds);
  metrics.received_bytes->Increment(double(end.received_bytes));
  metrics.sent_bytes->Increment(double(end.sent_bytes));
}

void Metrics::job(const std::string& tenant, const Status& status, const Spent& spent) {
  const JobMetrics& metrics = families_->of_tenant(tenant);
  metrics.ended[code_index(code_of(status))]->Increment();
  metrics.samples->Increment(double(spent.samples));
  metrics.rays->Increment(double(spent.rays));
  metrics.helper_seconds->Increment(spent.helper_seconds);
  metrics.queue_seconds->Observe(spent.waited_seconds);
  metrics.device_seconds->Observe(spent.seconds);
}

void Metrics::decode(const Status& status) {
  families_->decodes[code_index(code_of(status))]->Increment();
}

std::string_view code_name(int code) { return kCodes[code_index(code)]; }

void Metrics::identity_refused() { families_->refused_identities.Increment(); }

void Metrics::connection_refused() { families_->refused_connections.Increment(); }

std::string Metrics::text(const std::vector<MetricValue>& values) const {
  std::vector<prometheus::MetricFamily> all = families_->registry.Collect();
  for (const MetricValue& value : values) {
    const auto same = [&](const auto& family) { return family.name == value.name; };
    auto found = std::ranges::find_if(all, same);
    if (found == all.end()) found = all.insert(all.end(), family_of(value));
    found->metric.push_back(metric_of(value));
  }
  return prometheus::TextSerializer().Serialize(all);
}

}  // namespace heliograph::server
