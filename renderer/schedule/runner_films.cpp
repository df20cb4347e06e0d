// Films of shots with their scenes, and frames without pixels.
#include <algorithm>

#include "renderer/base/parallel.h"
#include "renderer/frame/check.h"
#include "renderer/frame/frame_header.h"
#include "renderer/frame/shutter.h"
#include "renderer/scene/motion.h"
#include "renderer/schedule/preparer.h"
#include "renderer/schedule/runner.h"

namespace heliograph {

/// Noise and post planes are made of one picture.
u32 Runner::at_once() const {
  if (measures_noise(*job_) || wants_post(*job_)) return 1;
  const uvec2 size = rendered_size(*job_, job_->cameras.front());
  return pictures_at_once(context_.backend.info(), u64(size.x) * size.y);
}

/// The film before is gone when the new one is begun.
std::future<Expected<Runner::Begun>> Runner::begin_later(std::shared_ptr<const RenderJob> whole,
                                                         PictureRange range) {
  const auto policy = at_once() > 1 ? std::launch::async : std::launch::deferred;
  return std::async(policy,
                    [this, whole = std::move(whole), range, before = std::move(begun_)]() mutable {
                      before = {};
                      return begin_worlds(*whole, range);
                    });
}

Expected<Runner::Begun> Runner::begin_worlds(const RenderJob& whole, PictureRange range) const {
  Begun begun;
  auto shots = shots_of(whole, range);
  if (!shots) return std::unexpected(std::move(shots).error());
  begun.shots = *std::move(shots);
  for (const SceneOf kind : wanted_scenes()) HELIO_TRY(prepare(begun.shots, kind));
  HELIO_TRY(begin(begun));
  return begun;
}

Expected<std::vector<Shot>> Runner::shots_of(const RenderJob& whole, PictureRange range) const {
  const u32 cameras = u32(whole.cameras.size()), first_world = range.begin / cameras;
  using Made = Expected<std::shared_ptr<RenderJob>>;
  std::vector<Made> worlds((range.end - 1) / cameras - first_world + 1);
  context_.backend.run([&] {
    parallel_for(worlds.size(), [&](std::size_t i) {
      worlds[i] = job_of_world(whole, whole.worlds->rendered[first_world + i]);
    });
  });
  for (Made& world : worlds)
    if (!world) return std::unexpected(std::move(world).error());
  std::vector<Shot> shots;
  for (u32 i = range.begin; i < range.end; ++i)
    shots.push_back({.job = *worlds[i / cameras - first_world], .camera = i % cameras});
  return shots;
}

Status Runner::begin(Begun& begun) const {
  auto film = context_.backend.begin(begun.shots);
  if (!film) return std::unexpected(std::move(film).error());
  begun.film = *std::move(film);
  for (const Shot& shot : begun.shots) begun.frames.push_back(frame_header(*shot.job, shot.camera));
  return {};
}

std::vector<Runner::SceneOf> Runner::wanted_scenes() const {
  std::vector<SceneOf> wanted;
  if (wants_open_shutter(*job_)) wanted.push_back(&Shot::open);
  if (wants_still(*job_)) wanted.push_back(&Shot::still);
  if (wants_forward(*job_)) wanted.push_back(&Shot::forward);
  if (wants_backward(*job_)) wanted.push_back(&Shot::backward);
  return wanted;
}

Steps Runner::make_scene(Shot& shot, SceneOf kind) {
  const TimeSpan span = span_of(shot, kind);
  shot.*kind = known_scene(shot, span);
  if (shot.*kind) co_return Status{};
  Preparer preparer(context_.backend, {shot.job->snapshot, span}, context_.interrupt);
  for (auto errands = preparer.next(); !errands.empty(); errands = preparer.next()) {
    HELIO_CO_TRY(co_await elsewhere(std::move(errands)));
    film_start_ = Clock::now();
  }
  auto made = preparer.take();
  if (!made) co_return std::unexpected(std::move(made).error());
  shot.*kind = *std::move(made);
  co_return context_.interrupt.status();
}

/// One kind of scene of all shots. What sees a world at the same time shares its scene.
Status Runner::prepare(std::vector<Shot>& shots, SceneOf kind) const {
  std::vector<SceneAt> wanted;
  std::vector<u32> of_shot;  // kNone: it has the scene
  for (Shot& shot : shots) {
    const TimeSpan span = span_of(shot, kind);
    shot.*kind = known_scene(shot, span);
    if (!(shot.*kind) && (wanted.empty() || wanted.back().snapshot != shot.job->snapshot ||
                          wanted.back().span != span))
      wanted.push_back({shot.job->snapshot, span});
    of_shot.push_back(shot.*kind ? kernels::kNone : u32(wanted.size() - 1));
  }
  const auto made = run_on(context_.backend,
                           [&] { return context_.backend.prepare(wanted, context_.interrupt); });
  if (!made) return std::unexpected(made.error());
  for (std::size_t i = 0; i < shots.size(); ++i)
    if (of_shot[i] != kernels::kNone) shots[i].*kind = (*made)[of_shot[i]];
  return context_.interrupt.status();
}

/// A scene of another kind that is there and the same; null: none is.
std::shared_ptr<const DeviceScene> Runner::known_scene(const Shot& shot, const TimeSpan& span) {
  for (const SceneOf kind : {&Shot::open, &Shot::still, &Shot::forward, &Shot::backward})
    if (shot.*kind && span_of(shot, kind) == span) return shot.*kind;
  return nullptr;
}

TimeSpan Runner::span_of(const Shot& shot, SceneOf kind) {
  const RenderJob& job = *shot.job;
  const Shutter& shutter = job.snapshot->find(job.cameras[shot.camera])->camera->shutter;
  if (kind == &Shot::open) return shutter_span(shutter, job.time);
  double later = 0;
  if (kind == &Shot::forward) later = flow_interval(job);
  if (kind == &Shot::backward) later = -flow_interval(job);
  return label_span(shutter, label_time(job) + later);
}

}  // namespace heliograph
