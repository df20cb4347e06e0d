// Edits of durable scenes: prepared, journaled, committed, published, acknowledged, in that order.
// Called by apply_numbered() and, for the second half, by the journal's thread.
#include "server/os/mutant.h"
#include "server/scene/scene_info.h"
#include "server/scene/scenes.h"

namespace heliograph::server {

void SceneEntry::commit(DurableEdit edit, const EditLog::Finish& finish) {
  JournalRecord record{.scene = id,
                       .tenant = tenant->name,
                       .sync = lifetime == v1::LIFETIME_DISK_SYNCED,
                       .files = std::move(edit.files),
                       .done = {}};
  Status appended;
  {
    const std::lock_guard lock(commit_mutex_);
    Expected<Prepared> prepared = std::unexpected(Error());
    if (edit.transaction)
      prepared = prepare(*edit.transaction, edit.expected);
    else
      prepared = std::unexpected(std::move(edit.transaction).error());
    if (prepared) {
      edit.record.set_revision(prepared->snapshot->revision);
    } else {
      edit.record.clear_transaction();
      edit.record.clear_transaction_file();
      edit.record.clear_assets();
      record.files.clear();
      *edit.record.mutable_refusal() = encode_refusal(prepared.error());
    }
    edit.record.set_scene(id);
    record.body = edit.record.SerializeAsString();
    SceneEvents::Event event;
    if (prepared)
      event = event_of(edit.sent.empty() ? edit.record.transaction() : edit.sent, *prepared);
    record.done = [self = shared_from_this(), number = edit.record.number(), prepared, event,
                   finish](const Status& committed) {
      self->end(prepared, event, committed);
      if (!committed) return finish(std::unexpected(committed.error()));
      if (!prepared) return finish(std::unexpected(prepared.error()));
      finish(apply_reply(number, *prepared));
    };
    if (has_bug("publish_before_commit") && prepared) scene.publish(*prepared);
    if (has_bug("ack_before_append") && prepared)
      finish(apply_reply(edit.record.number(), *prepared));
    appended = journal->append(std::move(record));
    if (!appended && prepared) drop_pending(prepared->snapshot->revision);
  }
  if (!appended) finish(std::unexpected(appended.error()));
}

void SceneEntry::end(const Expected<Prepared>& prepared, SceneEvents::Event event,
                     const Status& committed) {
  if (!prepared) return;
  {
    const std::lock_guard lock(commit_mutex_);
    if (!committed) return drop_pending(0);
    if (!has_bug("publish_before_commit")) publish(*prepared, std::move(event));
  }
  notify(prepared->snapshot->revision);
}

void SceneEntry::drop_pending(Revision first) {
  scene.drop_pending(first);
  charges_.drop(first, *scene.pending());
}

}  // namespace heliograph::server
