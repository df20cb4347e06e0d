// See scene_info.h.
#include "server/scene/scene_info.h"

#include <google/protobuf/wire_format_lite.h>

#include <array>

namespace heliograph::server {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedOutputStream;

v1::SceneInfo scene_info(Scenes& scenes, SceneEntry& scene, const Session& session) {
  const auto head = scene.scene.head();
  v1::SceneInfo info;
  info.set_scene(scene.id);
  info.set_name(scene.name);
  info.set_revision(head->revision);
  info.set_lifetime(scene.lifetime);
  info.set_time(head->time);
  info.set_next_edit(scenes.next_edit(scene, session.id()));
  return info;
}

void bring_up_to_date(Scenes& scenes, const Session& session, v1::SceneInfo& info) {
  if (const auto scene = scenes.find(info.scene(), session))
    info = scene_info(scenes, **scene, session);
}

v1::ApplyReply apply_reply(u64 number, const Prepared& prepared) {
  v1::ApplyReply reply;
  reply.set_number(number);
  reply.set_revision(prepared.snapshot->revision);
  reply.set_ids(prepared.ids.data(), prepared.ids.size() * sizeof(Id));
  reply.mutable_counts()->Add(prepared.counts.begin(), prepared.counts.end());
  return reply;
}

SceneEvents::Event event_of(std::string_view sent, const Prepared& prepared) {
  v1::WatchReply reply;
  reply.set_revision(prepared.snapshot->revision);
  reply.set_ids(prepared.ids.data(), prepared.ids.size() * sizeof(Id));
  reply.mutable_counts()->Add(prepared.counts.begin(), prepared.counts.end());
  std::array<u8, 16> head{};
  u8* end = WireFormatLite::WriteTagToArray(v1::WatchReply::kTransactionFieldNumber,
                                            WireFormatLite::WIRETYPE_LENGTH_DELIMITED, head.data());
  end = CodedOutputStream::WriteVarint64ToArray(sent.size(), end);
  std::string event;
  event.reserve(reply.ByteSizeLong() + head.size() + sent.size());
  reply.AppendToString(&event);
  event.append(head.data(), end).append(sent);
  return std::make_shared<const std::string>(std::move(event));
}

}  // namespace heliograph::server
