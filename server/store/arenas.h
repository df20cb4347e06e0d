// Frames in the host's memory that a local client maps: ranges of a few large memfds, so that a
// small frame costs neither a descriptor nor a mapping. Used by SharedFrames.
#pragma once

#include <map>
#include <memory>
#include <optional>

#include "server/store/ranges.h"
#include "server/store/sealed_memory.h"
#include "server/store/shared_room.h"

namespace heliograph::server {

/// The arenas of one session. A new one is as large as all before it together, within bounds, or as
/// one frame that needs more. What was handed out of it is charged, page by page.
///
/// A range is free again when the client has returned it and the daemon reads it no more. One that
/// nobody will return is lost, since the client may look at it for ever: its arena is handed out no
/// more, and ends with its last other use. Thread: its owner's mutex guards it.
class Arenas {
 public:
  explicit Arenas(SharedRoom& room) : room_(room) {}

  /// Aligned to 64 bytes; none where there is no room, or the socket takes nothing.
  [[nodiscard]] std::optional<Lease> lease(u64 bytes, u64 call);
  /// The client returns it. What names no use is ignored.
  void give_back(u64 buffer, u64 generation);
  /// The daemon neither reads nor writes it any more, and has sent it, or never will.
  void let_be(u64 generation, bool is_sent);
  /// Nobody can tell when it is over; false: it is no use of an arena.
  bool lose(u64 generation);
  /// The same for those of a call, whose number came before them.
  void abandon(u64 call);
  /// The client maps a buffer no more: it is announced again if something of it may still be on its
  /// way, else it ends. What is to be freed then, or null.
  [[nodiscard]] std::shared_ptr<SealedMemory> unmapped(u64 buffer);
  /// Ends an arena that nobody uses; false: there is none.
  bool let_go();
  [[nodiscard]] std::size_t uses() const { return uses_.size(); }

 private:
  struct Arena {
    std::shared_ptr<SealedMemory> memory;
    Ranges free;
    Charge charge;  // of the bytes up to the last that was ever in use
    Charge descriptor;
    u64 uses = 0;
    bool is_retired = false;  // handed out no more
  };
  struct Use {
    u64 arena = 0;
    u64 offset = 0;
    u64 bytes = 0;
    u64 call = 0;
    bool is_the_daemons = true;
    bool is_the_clients = true;
  };
  using Places = std::map<u64, Arena>;  // by number, the oldest first
  using Uses = std::map<u64, Use>;      // by generation, the oldest first

  [[nodiscard]] std::optional<u64> take(Arena& arena, u64 bytes);
  [[nodiscard]] Places::iterator make(u64 bytes);
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
