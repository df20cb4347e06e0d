// ApplyStream: numbered transactions one after another; replies in order, refusals included.
#pragma once

#include "server/service.h"

namespace heliograph::server {

/// One transaction is in work at a time; what the client sends ahead waits in gRPC's window.
class ApplyStreamCall final : public grpc::ServerBidiReactor<v1::ApplyRequest, v1::ApplyReply> {
 public:
  ApplyStreamCall(Daemon& daemon, Call call);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnDone() override { delete this; }

 private:
  Daemon& daemon_;
  Call call_;
  v1::ApplyRequest request_;
  v1::ApplyReply reply_;
};

}  // namespace heliograph::server
