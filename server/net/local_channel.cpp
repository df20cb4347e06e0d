// Tickets, messages and hang-ups of the local channel. Called by lifecycle.cpp and OpenSession.
#include "server/net/local_channel.h"

#include <sys/epoll.h>
#include <sys/random.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "server/os/packet.h"

namespace heliograph::server {
namespace {

constexpr std::size_t kTicketBytes = 16;
constexpr auto kPause = std::chrono::milliseconds(100);

}  // namespace

Expected<std::unique_ptr<LocalChannel>> LocalChannel::start(EventLoop& loop, const Log& log,
                                                            ListeningSocket listener, Limits limits,
                                                            Handlers handlers) {
  std::unique_ptr<LocalChannel> channel(new LocalChannel(loop, limits, std::move(handlers)));
  auto started = Listener::start(loop, log, std::move(listener),
                                 [self = channel.get()](ForeignFd connection, const Peer& peer) {
                                   self->accept(std::move(connection), peer);
                                 });
  if (!started) return std::unexpected(started.error());
  channel->listener_ = std::move(*started);
  return channel;
}

LocalChannel::LocalChannel(EventLoop& loop, Limits limits, Handlers handlers)
    : loop_(loop), limits_(limits), handlers_(std::move(handlers)) {}

LocalChannel::~LocalChannel() {
  for (const auto& [fd, connection] : connections_) loop_.forget(fd);
}

bool LocalChannel::has_room(pid_t process) const {
  if (connections_.size() >= limits_.total) return false;
  const auto of_peer = std::ranges::count_if(
      connections_, [&](const auto& entry) { return entry.second.process == process; });
  return process == 0 || u64(of_peer) < limits_.per_peer;
}

void LocalChannel::accept(ForeignFd connection, const Peer& peer) {
  const int fd = connection.get();
  std::string ticket(kTicketBytes, '\0');
  if (::getrandom(ticket.data(), ticket.size(), 0) != ssize_t(ticket.size())) return;
  {
    const std::lock_guard lock(mutex_);
    if (!has_room(peer.process)) return;
    connections_.emplace(fd, LocalConnection{.fd = std::move(connection),
                                             .process = peer.process,
                                             .number = ++last_number_,
                                             .ticket = ticket});
  }
  const bool sent = ::send(fd, ticket.data(), ticket.size(), MSG_NOSIGNAL) > 0;
  if (!sent || !watch(fd)) return on_event(fd, EPOLLHUP);
  loop_.after(limits_.unbound, [this, fd, number = last_number_, alive = std::weak_ptr(alive_)] {
    if (!alive.expired()) end_unbound(fd, number);
  });
}

void LocalChannel::end_unbound(int fd, u64 number) {
  {
    const std::lock_guard lock(mutex_);
    const auto connection = connections_.find(fd);
    if (connection == connections_.end() || connection->second.number != number ||
        connection->second.session != 0)
      return;
    connection->second.ticket.clear();  // nobody binds it from now on
  }
  on_event(fd, EPOLLHUP);
}

Status LocalChannel::watch(int fd) {
  return loop_.watch(fd, EPOLLIN | EPOLLRDHUP, [this, fd](u32 events) { on_event(fd, events); });
}

bool LocalChannel::is_full(int fd) {
  const std::lock_guard lock(mutex_);
  const auto connection = connections_.find(fd);
  return connection != connections_.end() && loop_.closer().is_full(connection->second.fd.sender());
}

/// Leaves the packets in the socket until descriptors of its sender were closed.
void LocalChannel::pause(int fd) {
  loop_.forget(fd);
  u64 number = 0;
  {
    const std::lock_guard lock(mutex_);
    number = connections_.at(fd).number;
  }
  loop_.after(kPause, [this, fd, number, alive = std::weak_ptr(alive_)] {
    if (alive.expired()) return;
    {
      const std::lock_guard lock(mutex_);
      const auto connection = connections_.find(fd);
      if (connection == connections_.end() || connection->second.number != number)
        return;  // the descriptor is another connection's now
    }
    if (!watch(fd)) on_event(fd, EPOLLHUP);
  });
}

void LocalChannel::on_event(int fd, u32 events) {
  if ((events & (EPOLLHUP | EPOLLRDHUP | EPOLLERR)) == 0)
    return is_full(fd) ? pause(fd) : receive_from(fd);
  loop_.forget(fd);
  u64 session = 0;
  {
    const std::lock_guard lock(mutex_);
    const auto found = connections_.find(fd);
    session = found->second.session;
    connections_.erase(found);
  }
  if (session != 0) handlers_.on_closed(session);
}

std::optional<LocalChannel::Packet> LocalChannel::receive(int fd) {
  Packet received;
  std::array<char, sizeof received.message> data{};
  const std::lock_guard lock(mutex_);
  const auto connection = connections_.find(fd);
  if (connection == connections_.end()) return std::nullopt;
  auto packet = receive_packet(connection->second.fd, data, MSG_DONTWAIT, loop_.closer());
  if (packet.size <= 0) return std::nullopt;
  received.session = connection->second.session;
  if (!packet.descriptors.empty()) received.fd = std::move(packet.descriptors.back());
  received.is_whole = packet.size == sizeof received.message;
  std::memcpy(&received.message, data.data(), data.size());
  return received;
}

void LocalChannel::receive_from(int fd) {
  constexpr int kMessagesAtOnce = 64;  // then other connections have their turn
  for (int i = 0; i < kMessagesAtOnce && !is_full(fd); ++i) {
    const std::lock_guard lock(delivery_mutex_);
    auto packet = receive(fd);
    if (!packet) return;
    if (packet->is_whole && packet->session != 0)
      handlers_.on_message(packet->session, packet->message, std::move(packet->fd));
  }
}

void LocalChannel::poll(u64 session) {
  int fd = -1;
  {
    const std::lock_guard lock(mutex_);
    const auto connection = find(session);
    if (connection == connections_.end()) return;
    fd = connection->first;
  }
  receive_from(fd);
}

LocalChannel::Connections::iterator LocalChannel::find(u64 session) {
  return std::ranges::find_if(connections_,
                              [&](const auto& entry) { return entry.second.session == session; });
}

bool LocalChannel::send(u64 session, const BufferMessage& message, const SharedMemory* memory) {
  const int fd = memory ? memory->fd() : -1;
  const DeviceUuid* device = memory ? memory->device() : nullptr;
  const std::lock_guard lock(mutex_);
  const auto connection = find(session);
  if (connection == connections_.end()) return false;
  std::array<iovec, 2> data{{{const_cast<BufferMessage*>(&message), sizeof message}, {}}};
  if (device) data[1] = {const_cast<u8*>(device->data()), device->size()};
  return send_packet(connection->first, std::span(data).first(device ? 2 : 1), fd);
}

Status LocalChannel::bind(const std::string& ticket, u64 session) {
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find_if(connections_, [&](const auto& entry) {
    return entry.second.session == 0 && entry.second.ticket == ticket;
  });
  if (ticket.size() != kTicketBytes || found == connections_.end())
    return fail(Code::kUnauthenticated, "ticket",
                "this ticket is not valid; connect to the daemon's local channel (SOCKET.fd.sock), "
                "receive a new one and keep that connection open");
  found->second.session = session;
  found->second.ticket.clear();
  return {};
}

void LocalChannel::release(u64 session) {
  loop_.post([this, session] {
    int fd = -1;
    {
      const std::lock_guard lock(mutex_);
      const auto found = find(session);
      if (found == connections_.end()) return;
      found->second.session = 0;
      fd = found->first;
    }
    on_event(fd, EPOLLHUP);
  });
}

}  // namespace heliograph::server
