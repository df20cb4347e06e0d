// What a request goes through between the wire and the engine, and what must hold whatever it is.
// Used by convert_fuzz_test, which replays the corpus, and by the libFuzzer target.
#pragma once

#include <google/protobuf/text_format.h>

#include <memory>
#include <string>
#include <string_view>

#include "renderer/scene/scene.h"
#include "server/convert/query.h"
#include "server/convert/render.h"
#include "server/convert/tracks.h"
#include "server/convert/transaction.h"
#include "tests/unit/convert_fixture.h"

namespace heliograph::fuzz {

using google::protobuf::Message;

constexpr SceneLimits kScene{.entities = 10'000, .array_bytes = 64 << 20};

/// The message that the first byte of an input names; nullptr for none.
inline std::unique_ptr<Message> message_of(char kind) {
  switch (kind) {
    case 't':
      return std::make_unique<v1::Transaction>();
    case 'r':
      return std::make_unique<v1::RenderRequest>();
    case 'q':
      return std::make_unique<v1::QueryRequest>();
    case 'k':
      return std::make_unique<v1::TracksRequest>();
    default:
      return nullptr;
  }
}

/// "ball" and its child, a material, a texture, a morphed mesh, "cam"; at 1 s, after an advance.
inline std::shared_ptr<const Snapshot> furnished() {
  v1::Transaction message;
  google::protobuf::TextFormat::ParseFromString(
      R"(edits { target { name: 'mesh' } mesh { } }
         edits { target { name: 'paint' } material { roughness { value: 0.3 } } }
         edits { target { name: 'ball' } entity { mesh { name: 'mesh' }
                 materials { parts { name: 'paint' } } label { auto: true category: 'ball' } } }
         edits { target { name: 'child' } entity { parent { name: 'ball' } mesh { name: 'mesh' } } }
         edits { target { name: 'cam' }
                 entity { camera { width: 32 height: 24 fx: 30 fy: 30 cx: 15.5 cy: 11.5 } } }
         edits { settings { time: 0.5 } }
         edits { advance { dt: 0.5 } })",
      &message);
  *message.mutable_edits(0)->mutable_mesh() = server::triangle();
  server::InlineSource source;
  const auto transaction = server::to_transaction(message, source);
  if (!transaction) return nullptr;
  auto prepared = apply(Snapshot{}, *transaction, kScene);
  return prepared ? prepared->snapshot : nullptr;
}

/// What is wrong with a refusal, or "".
inline std::string fault_of(const Error& error) {
  const std::string shown = error.where + ": " + error.message;
  if (error.message.empty()) return "a refusal without words at " + error.where;
  const bool is_wrong = error.code == Code::kInvalidArgument || error.code == Code::kNotFound;
  if (is_wrong && error.where.empty()) return "wrong, but not told where: " + shown;
  if (error.code == Code::kInternal) return "INTERNAL " + shown;
  return "";
}

/// An accepted transaction is what it says it is, and the scene that it makes can be written down
/// and built again.
inline std::string attempt_edits(const v1::Transaction& message, const Snapshot& base) {
  server::InlineSource source;
  const auto transaction = server::to_transaction(message, source);
  if (!transaction) return fault_of(transaction.error());
  const v1::Transaction once = server::to_proto(*transaction, server::inline_sink);
  const auto again = server::to_transaction(once, source);
  if (!again) return "does not come back: " + again.error().where + again.error().message;
  if (server::to_proto(*again, server::inline_sink).SerializeAsString() != once.SerializeAsString())
    return "comes back otherwise";
  const auto prepared = apply(base, *transaction, kScene);
  if (!prepared) return fault_of(prepared.error());
  const auto rebuilt = rebuild(describe(*prepared->snapshot), kScene);
  if (!rebuilt) return "cannot be rebuilt: " + rebuilt.error().where + rebuilt.error().message;
  return "";
}

/// What must not be, or "".
inline std::string attempt(const Message& message) {
  static const std::shared_ptr<const Snapshot> base = furnished();
  if (!base) return "the scene of this test is refused";
  if (const auto* edits = dynamic_cast<const v1::Transaction*>(&message))
    return attempt_edits(*edits, *base);
  if (auto known = server::check_known(message); !known) return fault_of(known.error());
  server::InlineSource source;
  Status status;
  const auto keep = [&](const auto& made) {
    if (!made) status = std::unexpected(made.error());
  };
  if (const auto* render = dynamic_cast<const v1::RenderRequest*>(&message)) {
    if (render->has_overlay())
      if (auto fault = attempt_edits(render->overlay(), *base); !fault.empty()) return fault;
    keep(server::to_job(*render, base, {}));
  } else if (const auto* query = dynamic_cast<const v1::QueryRequest*>(&message)) {
    keep(server::to_query(*query, base, source, {.items = 4096}));
  } else if (const auto* tracks = dynamic_cast<const v1::TracksRequest*>(&message)) {
    keep(server::to_tracks(*tracks, base, source, {.items = 4096}));
  }
  return status ? "" : fault_of(status.error());
}

/// An input's message; nullptr where it is none.
inline std::unique_ptr<Message> parse(std::string_view input) {
  auto message = input.empty() ? nullptr : message_of(input[0]);
  if (!message || !message->ParseFromArray(input.data() + 1, int(input.size() - 1))) return nullptr;
  return message;
}

}  // namespace heliograph::fuzz
