// Saves scenes that are not durable for the next daemon. See journal.h.
#include <fmt/format.h>

#include <algorithm>

#include "server/journal/journal.h"

namespace heliograph::server {
namespace {

std::unexpected<Error> too_many(u64 bytes) {
  return fail(Code::kResourceExhausted, "",
              fmt::format("only {} bytes are left for scenes (limit saved_bytes)", bytes));
}

}  // namespace

/// Small scenes first, so that most are saved when not all fit.
Journal::Saved Journal::save(std::vector<SceneState> states, u64 bytes) {
  std::ranges::sort(states, {}, [](const SceneState& state) { return array_bytes(*state.head); });
  Saved saved;
  std::set<const BlobFile*> counted;
  auto control = std::make_shared<Control>();
  for (SceneState& state : states) {
    auto more = store_within(state, bytes - saved.bytes, counted, *control);
    if (more) {
      saved.bytes += *more;
      ++saved.scenes;
      continue;
    }
    ++saved.lost;
    saved.because = std::unexpected(std::move(more).error());
    sweep();  // removes files written for it
  }
  if (control->added.empty()) return saved;
  if (Status committed = run(std::move(control)); !committed)
    return {.lost = states.size(), .because = std::move(committed)};
  return saved;
}

/// Returns the bytes of its files that no earlier scene shares.
Expected<u64> Journal::store_within(SceneState& state, u64 bytes,
                                    std::set<const BlobFile*>& counted, Control& control) {
  auto stored = store_state(state, files(state.row.tenant()), Room::kSnapshot);
  if (!stored) return std::unexpected(std::move(stored).error());
  u64 more = 0;
  std::set<const BlobFile*> own;
  for (const BlobFilePtr& file : *stored)
    if (!counted.contains(file.get()) && own.insert(file.get()).second) more += size_of(*file);
  if (more > bytes) return too_many(bytes);
  counted.merge(own);
  state.row.set_saved(true);
  control.files.emplace(state.row.scene(), std::move(*stored));
  control.added.push_back(std::move(state.row));
  return more;
}

}  // namespace heliograph::server
