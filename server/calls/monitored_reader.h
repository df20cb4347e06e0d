// Client streams that end when nothing arrives: UploadBlob and ImportScene.
#pragma once

#include <memory>
#include <mutex>

#include "server/calls/rpc.h"

namespace heliograph::server {

/// Reads one message at a time. Refuses a client that sends nothing for stall_seconds and frees
/// what it has sent. Lifetime: until gRPC is done with it, or the last tick has ended.
template <class Message>
class MonitoredReader : public grpc::ServerReadReactor<Message>, public Monitored {
 public:
  /// Starts the call, which owns itself.
  static MonitoredReader* start(std::shared_ptr<MonitoredReader> made, Daemon& daemon) {
    made->self_ = made;
    daemon.stall_monitor.add(made);
    made->read();
    return made.get();
  }

  void OnReadDone(bool ok) override {
    {
      const std::lock_guard lock(mutex_);
      is_reading_ = false;
      if (is_finished_) return;
    }
    came(ok);
  }
  void OnDone() override {
    end_ticks();
    let_go();  // here, since the last owner may be a tick
    self_.reset();
  }
  void on_tick(EventLoop::Clock::time_point now) override {
    const std::lock_guard lock(mutex_);
    if (is_finished_ || !is_reading_ || !standstill_.is_longer_than(stall_seconds_, now)) return;
    // May free gigabytes, so in the pool. When the pool is full, the next tick tries again.
    is_finished_ = bool(pool_.post(WorkPool::kDaemon, [self = self_] { self->end_stalled(); }));
  }

 protected:
  MonitoredReader(Daemon& daemon, grpc::CallbackServerContext& context)
      : context_(context),
        pool_(daemon.pool),
        stall_seconds_(double(daemon.config.limits.stall_seconds)) {}

  /// A read ended; false: the client sends no more. read() or finish() follows.
  virtual void came(bool ok) = 0;
  /// Frees what was received.
  virtual void let_go() = 0;

  void read() {
    {
      const std::lock_guard lock(mutex_);
      is_reading_ = true;
      standstill_.moved();
    }
    this->StartRead(&message_);
  }
  void finish(const Status& status) {
    {
      const std::lock_guard lock(mutex_);
      is_finished_ = true;
    }
    this->Finish(to_status(status, context_));
  }
  [[nodiscard]] grpc::CallbackServerContext& context() const { return context_; }
  [[nodiscard]] Message& message() { return message_; }

 private:
  void end_stalled() {
    let_go();
    this->Finish(to_status(
        fail(Code::kResourceExhausted, "",
             fmt::format("nothing came for {} s; call when the bytes are there, and send them "
                         "without a break (limit stall_seconds)",
                         stall_seconds_)),
        context_));
  }

  grpc::CallbackServerContext& context_;
  WorkPool& pool_;
  const double stall_seconds_;
  Message message_;
  std::mutex mutex_;
  bool is_reading_ = false;
  bool is_finished_ = false;
  Standstill standstill_;
  std::shared_ptr<MonitoredReader> self_;  // until OnDone
};

}  // namespace heliograph::server
