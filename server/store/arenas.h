// Frames in host memory that a local client maps: ranges of a few large memfds, so that a small
// frame costs neither a descriptor nor a mapping. Used by SharedFrames.
#pragma once

#include <map>
#include <memory>
#include <optional>

#include "server/store/ranges.h"
#include "server/store/sealed_memory.h"
#include "server/store/shared_room.h"

namespace heliograph::server {

/// The arenas of one session. A new arena is as large as all earlier ones together, within bounds,
/// or as the frame that needs it. Memory that was ever handed out is charged, page by page.
///
/// A range is free once the client has returned it and the daemon has stopped reading it. A range
/// that will never be returned is lost, since the client may read it for ever: its arena is
/// retired, and ends with its last other lease. Thread: guarded by its owner's mutex.
class Arenas {
 public:
  explicit Arenas(SharedRoom& room) : room_(room) {}

  /// Leases a range, aligned to 64 bytes, of the arenas that are there. None when they are full.
  [[nodiscard]] std::optional<Lease> reuse(u64 bytes, u64 call);
  /// The same, or of a new arena. None when there is no room, or the socket accepts nothing.
  [[nodiscard]] std::optional<Lease> lease(u64 bytes, u64 call);
  /// Ends the client's use of a lease. Ignores an unknown generation.
  void give_back(u64 buffer, u64 generation);
  /// Ends the daemon's use of a lease. is_sent: the client has it and will return it.
  void let_be(u64 generation, bool is_sent);
  /// Marks a lease as lost. False: no lease of an arena has this generation.
  bool lose(u64 generation);
  /// Marks all leases of a call as lost.
  void abandon(u64 call);
  /// The client has unmapped an arena. It is announced again if a range of it may still be in
  /// flight to the client, else it ends. Returns the memory to free, or null.
  [[nodiscard]] std::shared_ptr<SealedMemory> unmapped(u64 buffer);
  /// Ends an unused arena; false: there is none.
  bool let_go();
  [[nodiscard]] std::size_t uses() const { return uses_.size(); }

 private:
  struct Arena {
    std::shared_ptr<SealedMemory> memory;
    Ranges free;
    Charge charge;  // up to the end of the last page ever in use
    Charge descriptor;
    u64 uses = 0;
    bool is_retired = false;  // gives no further leases
  };
  struct Use {
    u64 arena = 0;
    u64 offset = 0;
    u64 bytes = 0;
    u64 call = 0;
    bool is_the_daemons = true;
    bool is_the_clients = true;
  };
  using Places = std::map<u64, Arena>;  // by number, oldest first
  using Uses = std::map<u64, Use>;      // by generation, oldest first

  [[nodiscard]] std::optional<u64> take(Arena& arena, u64 bytes);
  [[nodiscard]] Places::iterator make(u64 bytes);
  Lease use(Places::iterator arena, Use use);
  void end_if_over(Uses::iterator use);
  Uses::iterator lose(Uses::iterator use);
  void end_use(Places::iterator arena);
  void end(Places::iterator arena, bool is_known = false);

  SharedRoom& room_;
  Places arenas_;
  Uses uses_;
  u64 size_ = 0;  // bytes of all arenas
};

}  // namespace heliograph::server
