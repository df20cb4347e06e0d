// Tickets, words and hang-ups of the second socket. Called by main and OpenSession.
#include "server/net/lifeline.h"

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

Expected<std::unique_ptr<Lifelines>> Lifelines::start(EventLoop& loop, const Log& log,
                                                      ListeningSocket listener, Limits limits,
                                                      Handlers handlers) {
  std::unique_ptr<Lifelines> lifelines(new Lifelines(loop, limits, std::move(handlers)));
  auto started = Listener::start(loop, log, std::move(listener),
                                 [self = lifelines.get()](ForeignFd connection, const Peer& peer) {
                                   self->take(std::move(connection), peer);
                                 });
  if (!started) return std::unexpected(started.error());
  lifelines->listener_ = std::move(*started);
  return lifelines;
}

Lifelines::Lifelines(EventLoop& loop, Limits limits, Handlers handlers)
    : loop_(loop), limits_(limits), handlers_(std::move(handlers)) {}

Lifelines::~Lifelines() {
  for (const auto& [fd, line] : lines_) loop_.forget(fd);
}

bool Lifelines::has_room(pid_t process) const {
  if (lines_.size() >= limits_.total) return false;
  const auto of_peer = std::ranges::count_if(
      lines_, [&](const auto& entry) { return entry.second.process == process; });
  return process == 0 || u64(of_peer) < limits_.per_peer;
}

void Lifelines::take(ForeignFd connection, const Peer& peer) {
  const int fd = connection.get();
  std::string ticket(kTicketBytes, '\0');
  if (::getrandom(ticket.data(), ticket.size(), 0) != ssize_t(ticket.size())) return;
  {
    const std::lock_guard lock(mutex_);
    if (!has_room(peer.process)) return;
    lines_.emplace(fd, Line{.fd = std::move(connection),
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

void Lifelines::end_unbound(int fd, u64 number) {
  {
    const std::lock_guard lock(mutex_);
    const auto line = lines_.find(fd);
    if (line == lines_.end() || line->second.number != number || line->second.session != 0) return;
    line->second.ticket.clear();  // nobody binds it from now on
  }
  on_event(fd, EPOLLHUP);
}

Status Lifelines::watch(int fd) {
  return loop_.watch(fd, EPOLLIN | EPOLLRDHUP, [this, fd](u32 events) { on_event(fd, events); });
}

bool Lifelines::is_full(int fd) {
  const std::lock_guard lock(mutex_);
  const auto line = lines_.find(fd);
  return line != lines_.end() && loop_.closer().is_full(line->second.fd.sender());
}

/// What waits there stays until descriptors of its sender were closed.
void Lifelines::pause(int fd) {
  loop_.forget(fd);
  u64 number = 0;
  {
    const std::lock_guard lock(mutex_);
    number = lines_.at(fd).number;
  }
  loop_.after(kPause, [this, fd, number, alive = std::weak_ptr(alive_)] {
    if (alive.expired()) return;
    {
      const std::lock_guard lock(mutex_);
      const auto line = lines_.find(fd);
      if (line == lines_.end() || line->second.number != number) return;  // another has its place
    }
    if (!watch(fd)) on_event(fd, EPOLLHUP);
  });
}

void Lifelines::on_event(int fd, u32 events) {
  if ((events & (EPOLLHUP | EPOLLRDHUP | EPOLLERR)) == 0)
    return is_full(fd) ? pause(fd) : listen_to(fd);
  loop_.forget(fd);
  u64 session = 0;
  {
    const std::lock_guard lock(mutex_);
    const auto found = lines_.find(fd);
    session = found->second.session;
    lines_.erase(found);
  }
  if (session != 0) handlers_.lost(session);
}

std::optional<Lifelines::Heard> Lifelines::receive(int fd) {
  Heard heard;
  std::array<char, sizeof heard.word> data{};
  const std::lock_guard lock(mutex_);
  const auto line = lines_.find(fd);
  if (line == lines_.end()) return std::nullopt;
  auto packet = receive_packet(line->second.fd, data, MSG_DONTWAIT, loop_.closer());
  if (packet.size <= 0) return std::nullopt;
  heard.session = line->second.session;
  if (!packet.descriptors.empty()) heard.fd = std::move(packet.descriptors.back());
  heard.is_word = packet.size == sizeof heard.word;
  std::memcpy(&heard.word, data.data(), data.size());
  return heard;
}

void Lifelines::listen_to(int fd) {
  constexpr int kWordsAtOnce = 64;  // then it is others' turn
  for (int i = 0; i < kWordsAtOnce && !is_full(fd); ++i) {
    const std::lock_guard lock(hearing_);
    auto heard = receive(fd);
    if (!heard) return;
    if (heard->is_word && heard->session != 0)
      handlers_.said(heard->session, heard->word, std::move(heard->fd));
  }
}

void Lifelines::hear(u64 session) {
  int fd = -1;
  {
    const std::lock_guard lock(mutex_);
    const auto line = find(session);
    if (line == lines_.end()) return;
    fd = line->first;
  }
  listen_to(fd);
}

Lifelines::Lines::iterator Lifelines::find(u64 session) {
  return std::ranges::find_if(lines_,
                              [&](const auto& entry) { return entry.second.session == session; });
}

bool Lifelines::tell(u64 session, const BufferWord& word, const SharedMemory* memory) {
  const int fd = memory ? memory->fd() : -1;
  const DeviceUuid* device = memory ? memory->device() : nullptr;
  const std::lock_guard lock(mutex_);
  const auto line = find(session);
  if (line == lines_.end()) return false;
  std::array<iovec, 2> data{{{const_cast<BufferWord*>(&word), sizeof word}, {}}};
  if (device) data[1] = {const_cast<u8*>(device->data()), device->size()};
  return send_packet(line->first, std::span(data).first(device ? 2 : 1), fd);
}

Status Lifelines::bind(const std::string& ticket, u64 session) {
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find_if(lines_, [&](const auto& entry) {
    return entry.second.session == 0 && entry.second.ticket == ticket;
  });
  if (ticket.size() != kTicketBytes || found == lines_.end())
    return fail(Code::kUnauthenticated, "ticket",
                "this ticket is not valid; connect to the daemon's second socket (SOCKET.fd.sock), "
                "receive a new one and keep that connection open");
  found->second.session = session;
  found->second.ticket.clear();
  return {};
}

void Lifelines::release(u64 session) {
  loop_.post([this, session] {
    int fd = -1;
    {
      const std::lock_guard lock(mutex_);
      const auto found = find(session);
      if (found == lines_.end()) return;
      found->second.session = 0;
      fd = found->first;
    }
    on_event(fd, EPOLLHUP);
  });
}

}  // namespace heliograph::server
