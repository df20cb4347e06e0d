// The lines of call_log.h.
#include "server/observe/call_log.h"

#include <grpcpp/support/status.h>

#include <vector>

namespace heliograph::server {
namespace {

double seconds_between(CallClock::time_point from, CallClock::time_point to) {
  return std::chrono::duration<double>(to - from).count();
}

LogField milliseconds(std::string_view name, double seconds) {
  return {name, fmt::format("{:.3f}", 1000 * std::max(seconds, 0.0))};
}

/// Returns the fields that identify a call and its caller.
std::vector<LogField> fields_of(const CallFacts& facts) {
  std::vector<LogField> fields{{"request", facts.request}, {"method", facts.method}};
  const auto add = [&](std::string_view name, std::string_view value) {
    if (!value.empty()) fields.emplace_back(name, value);
  };
  if (facts.trace) {
    add("trace_id", facts.trace.trace_id());
    add("span_id", facts.trace.span_id());
  }
  add("tenant", facts.tenant);
  add("client", facts.client);
  add("peer", facts.peer);
  if (facts.scene != 0) fields.emplace_back("scene", facts.scene);
  add("scene_name", facts.scene_name);
  return fields;
}

/// Adds the time that a call with jobs spent: before them, waiting, on derived data, on the device,
/// while other jobs had it, after them.
void add_times(std::vector<LogField>& fields, const CallFacts& facts, CallClock::time_point now) {
  const CallJobs& jobs = facts.jobs;
  if (jobs.count == 0) return;
  const double known = jobs.waited_seconds + jobs.aside_seconds + jobs.device_seconds;
  fields.push_back(milliseconds("before_ms", seconds_between(facts.start, jobs.first)));
  fields.push_back(milliseconds("queued_ms", jobs.waited_seconds));
  fields.push_back(milliseconds("derived_ms", jobs.aside_seconds));
  fields.push_back(milliseconds("device_ms", jobs.device_seconds));
  if (jobs.count == 1)
    fields.push_back(milliseconds("others_ms", seconds_between(jobs.first, jobs.last) - known));
  fields.push_back(milliseconds("sending_ms", seconds_between(jobs.last, now)));
}

}  // namespace

bool CallLog::is_slow(Pace pace, double seconds) const {
  if (pace == Pace::kClient) return false;
  return seconds > (pace == Pace::kRender ? options_.slow_render_seconds : options_.slow_seconds);
}

void CallLog::end(CallFacts facts, const CallOutcome& outcome) const {
  const CallClock::time_point now = CallClock::now();
  const double seconds = seconds_between(facts.start, now);
  metrics_.call({.method = facts.method,
                 .code = outcome.code,
                 .seconds = seconds,
                 .received_bytes = facts.received_bytes,
                 .sent_bytes = facts.sent_bytes});
  const bool is_slow_one = !outcome.is_hidden && is_slow(facts.pace, seconds);
  const bool is_quiet = outcome.code == grpc::OK || outcome.code == grpc::CANCELLED;
  const Log::Level level = outcome.is_hidden ? Log::Level::kError
                           : is_slow_one     ? Log::Level::kWarning
                           : is_quiet        ? Log::Level::kDebug
                                             : Log::Level::kInfo;
  if (!log_.is_on(level)) return;
  if (facts.scene_name.empty() && facts.scene != 0 && facts.session != 0)
    facts.scene_name = options_.scene_name(facts.scene, facts.session);
  std::vector<LogField> fields = fields_of(facts);
  fields.emplace_back("code", code_name(outcome.code));
  if (!outcome.reason.empty()) fields.emplace_back("reason", outcome.reason);
  fields.push_back(milliseconds("ms", seconds));
  fields.emplace_back("received_bytes", facts.received_bytes);
  fields.emplace_back("sent_bytes", facts.sent_bytes);
  if (is_slow_one) add_times(fields, facts, now);
  log_.write(level, is_slow_one ? "slow call" : "call", fields);
}

void CallLog::end_job(const CallRecord& call, double seconds, const Spent& spent) const {
  if (!is_slow(Pace::kRender, seconds)) return;
  const CallFacts facts = call.facts();
  if (facts.pace != Pace::kClient) return;
  std::vector<LogField> fields = fields_of(facts);
  fields.push_back(milliseconds("ms", seconds));
  fields.push_back(milliseconds("queued_ms", spent.waited_seconds));
  fields.push_back(milliseconds("derived_ms", spent.aside_seconds));
  fields.push_back(milliseconds("device_ms", spent.seconds));
  fields.push_back(milliseconds(
      "others_ms", seconds - spent.waited_seconds - spent.aside_seconds - spent.seconds));
  log_.write(Log::Level::kWarning, "slow job", fields);
}

}  // namespace heliograph::server
