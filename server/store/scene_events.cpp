// Keeping, finding and forgetting events. See scene_events.h.
#include "server/store/scene_events.h"

#include <fmt/format.h>

#include "server/os/mutant.h"

namespace heliograph::server {
namespace {

constexpr u64 kEventBytes = 96;  // overhead of an event beyond its text

u64 cost(const SceneEvents::Event& event) { return event->size() + kEventBytes; }

std::unexpected<Error> out_of_range(std::string message, Revision nearest) {
  Error error{.code = Code::kOutOfRange, .message = std::move(message), .where = "from_revision"};
  error.expected = nearest;
  return std::unexpected(std::move(error));
}

}  // namespace

SceneEvents::SceneEvents(EventLimits limits, std::shared_ptr<Budget> budget, Revision head)
    : limits_(limits), head_(head), charge_(Charge::none(std::move(budget))) {}

bool SceneEvents::is_kept() const {
  const std::lock_guard lock(mutex_);
  return is_kept_;
}

void SceneEvents::keep() {
  const std::lock_guard lock(mutex_);
  is_kept_ = true;
}

SceneEvents::Event SceneEvents::forget_oldest() {
  Event event = std::move(events_.front());
  events_.pop_front();
  bytes_ -= cost(event);
  return event;
}

void SceneEvents::add(Revision revision, Event event) {
  std::vector<Event> forgotten;  // freed after the mutex is released
  const std::lock_guard lock(mutex_);
  head_ = revision;
  if (!event || (has_bug("drop_event") && revision % 8 == 0)) return;
  bytes_ += cost(event);
  events_.push_back(std::move(event));
  while (events_.size() > 1 && (events_.size() > limits_.events || bytes_ > limits_.bytes))
    forgotten.push_back(forget_oldest());
  while (!charge_.resize(bytes_)) forgotten.push_back(forget_oldest());
}

Revision SceneEvents::head() const {
  const std::lock_guard lock(mutex_);
  return head_;
}

Expected<SceneEvents::Event> SceneEvents::at(Revision revision) const {
  const std::lock_guard lock(mutex_);
  if (revision == head_ + 1) return nullptr;
  if (revision > head_ + 1)
    return out_of_range(fmt::format("{} is not there yet; the scene is at revision {}, watch from "
                                    "{} on",
                                    revision, head_, head_ + 1),
                        head_ + 1);
  if (revision < oldest())
    return out_of_range(
        fmt::format("{} is compacted, the oldest that can be had is {}; read the scene, and watch "
                    "from the revision after that on (limits watch_events, watch_bytes)",
                    revision, oldest()),
        oldest());
  return events_[std::size_t(revision - oldest())];
}

std::vector<SceneEvents::Event> SceneEvents::list(Revision last) const {
  const std::lock_guard lock(mutex_);
  const u64 newer = head_ - std::min(head_, last);
  const u64 count = events_.size() - std::min<u64>(events_.size(), newer);
  return {events_.begin(), events_.begin() + std::ptrdiff_t(count)};
}

}  // namespace heliograph::server
