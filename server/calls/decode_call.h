// DecodeAsset in flight: collects the files, decodes them, stores the asset and replies.
#pragma once

#include <deque>
#include <mutex>
#include <optional>

#include "server/calls/rpc.h"
#include "server/calls/service.h"
#include "server/decode/decoder.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// One call. Thread: any, one step at a time. Deletes itself when gRPC is done.
class DecodeCall final : public Writer<v1::DecodeAssetReply> {
 public:
  DecodeCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call,
             const v1::DecodeAssetRequest& request)
      : daemon_(daemon), context_(context), call_(std::move(call)), request_(request) {}

  /// Starts on the pool; ends the call when the pool is full.
  void post(WorkPool& pool) {
    if (auto posted = pool.post(call_.tenant()->id, [this] { start(); }); !posted)
      finish(std::unexpected(posted.error()));
  }

  void OnWriteDone(bool ok) override;
  void OnCancel() override { stop_.request_stop(); }
  void OnDone() override { delete this; }

 private:
  using Replies = std::deque<v1::DecodeAssetReply>;
  using Result = Expected<Replies>;

  void start();
  /// Collects all files. Those of the asset root are read in the decoder's threads, as the disk may
  /// be slow.
  void gather_all();
  [[nodiscard]] Status gather();
  [[nodiscard]] Status gather_bundle();
  /// Charges and reads a file beneath the asset root.
  [[nodiscard]] Status gather_file(const std::string& path, const std::string& name);
  void submit();
  /// Charges the copies of all files that the decoder gets.
  [[nodiscard]] Status charge_copy();
  void on_decoded(Expected<Decoded> decoded);
  /// Reads companions that the model of a server_path lacks. Returns true when any was found.
  [[nodiscard]] Expected<bool> gather_missing(const std::vector<std::string>& missing);
  [[nodiscard]] Result store(const Decoded& decoded);
  void send_progress(double done);
  void finish(Result result);
  void finish_now();

  Daemon& daemon_;
  grpc::CallbackServerContext& context_;
  Call call_;
  const v1::DecodeAssetRequest& request_;
  std::stop_source stop_;
  // Its threads may hold this call while the daemon releases the decoder.
  Decoder* decoder_ = nullptr;
  v1::DecodeAssetRequest named_;  // the decoded bundle: its files, by hash, and its options
  std::vector<DecodeFile> files_;
  std::vector<Charge> read_;  // of files of the asset root
  Charge copy_;               // held while the decoder has the copies
  std::string hash_;
  std::mutex mutex_;
  bool is_writing_ = false;
  std::optional<Result> result_;  // replies to be sent
  v1::DecodeAssetReply reply_;
};

}  // namespace heliograph::server
