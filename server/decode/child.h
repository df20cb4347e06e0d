// One decode inside the sandbox: a job's region in, a result's region out.
#pragma once

#include "server/decode/decoded.pb.h"
#include "server/decode/wire.h"

namespace heliograph::server {

/// Decodes the job and sends its result on `socket`. Never fails: a refusal is a result too.
void run_job(const Region& job, int socket);

/// The files of a job, as spans of its region; fails when they leave it.
[[nodiscard]] Expected<decode::Job> read_job(const Region& region, std::vector<Bytes>& files);

}  // namespace heliograph::server
