// One decode inside the sandbox: a job's region in, a result's region out.
#pragma once

#include "server/decode/decoded.pb.h"
#include "server/decode/helpers.h"
#include "server/decode/wire.h"

namespace heliograph::server {

/// Decodes the job, asks the daemon for room, writes the result and says so. Never fails: a refusal
/// is a result too, and a child that ends without one is seen.
void run_job(const Region& job, Helpers& helpers);

/// The files of a job, as spans of its region; fails when they leave it.
[[nodiscard]] Expected<decode::Job> read_job(const Region& region, std::vector<Bytes>& files);

}  // namespace heliograph::server
