// One decode inside the sandbox: a job's region in, a result's region out.
#pragma once

#include "server/decode/decoded.pb.h"
#include "server/decode/wire.h"

namespace heliograph::server {

/// Decodes the job, writes its result to the memfd `result` and says so on `socket`. Never fails: a
/// refusal is a result too. (The memfd is the daemon's: a child that sent one of its own would fail
/// where more descriptors of its user are on their way between any processes than it may open.)
void run_job(const Region& job, int socket, int result);

/// The files of a job, as spans of its region; fails when they leave it.
[[nodiscard]] Expected<decode::Job> read_job(const Region& region, std::vector<Bytes>& files);

}  // namespace heliograph::server
