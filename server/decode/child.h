// One decode in the sandbox: reads the job's region, writes the result's.
#pragma once

#include "server/decode/decoded.pb.h"
#include "server/decode/helpers.h"
#include "server/decode/wire.h"

namespace heliograph::server {

/// Decodes the job, requests room from the daemon, writes the result and reports it. Never fails: a
/// refusal is a result too, and the daemon notices a child that ends without one.
void run_job(const Region& job, Helpers& helpers);

/// Reads a job; its files are spans of the region. Fails when they lie outside of it.
[[nodiscard]] Expected<decode::Job> read_job(const Region& region, std::vector<Bytes>& files);

}  // namespace heliograph::server
