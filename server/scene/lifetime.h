// Lifetime of scenes: the contract's Lifetime, and the journal's Durability.
#pragma once

#include "heliograph/v1/types.pb.h"
#include "server/journal/record.pb.h"

namespace heliograph::server {

/// Replaces the unspecified value by the default.
[[nodiscard]] inline v1::Lifetime or_default(v1::Lifetime lifetime) {
  return lifetime == v1::LIFETIME_UNSPECIFIED ? v1::LIFETIME_SESSION : lifetime;
}
/// Returns true for lifetimes that are journaled.
[[nodiscard]] inline bool is_durable(v1::Lifetime lifetime) {
  return lifetime == v1::LIFETIME_DISK || lifetime == v1::LIFETIME_DISK_SYNCED;
}
[[nodiscard]] inline const char* durability_of(v1::Lifetime lifetime) {
  return lifetime == v1::LIFETIME_DISK_SYNCED ? "fsync" : lifetime == v1::LIFETIME_DISK ? "os" : "";
}
[[nodiscard]] inline v1::Lifetime lifetime_of(const journal::SceneRow& row) {
  if (row.durability() == "fsync") return v1::LIFETIME_DISK_SYNCED;
  if (row.durability() == "os") return v1::LIFETIME_DISK;
  return row.owner() == 0 ? v1::LIFETIME_DAEMON : v1::LIFETIME_SESSION;
}

}  // namespace heliograph::server
