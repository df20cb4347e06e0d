// Starting the engine and rendering its first pixel. Called by main.
#include "server/device/engine_slot.h"

#include <algorithm>

#include "renderer/scene/scene.h"

namespace heliograph::server {
namespace {

constexpr u64 kProbeTenant = ~u64(0);  // a tenant of its own: waits for one slice of others at most
constexpr double kSoonest = 0.01;      // seconds: shortest retry time

class ProbeSink final : public JobSink {
 public:
  explicit ProbeSink(std::function<void(Status)> done) : done_(std::move(done)) {}
  void progress(const Progress&) override {}
  void frame(std::shared_ptr<const Frame> frame) override { frames_ += frame ? 1u : 0u; }
  void done(Status status, const Spent&) override {
    if (status && frames_ == 0) status = fail(Code::kInternal, "", "the engine gave no frame");
    done_(status);
  }

 private:
  std::function<void(Status)> done_;
  u32 frames_ = 0;
};

}  // namespace

EngineSlot::EngineSlot(EngineOptions options, const Log& log, std::function<void(Status)> first)
    : log_(log), first_(std::move(first)), future_(promise_.get_future().share()) {
  thread_ = std::thread([this, options = std::move(options)] { start(options); });
}

EngineSlot::~EngineSlot() {
  closing_ = true;
  thread_.join();
  engine_.reset();  // first: its last callbacks use the members declared after it
}

void EngineSlot::start(const EngineOptions& options) {
  auto engine = Engine::create(options);
  if (!engine) {
    promise_.set_value(std::unexpected(engine.error()));
    return finish(std::unexpected(engine.error()));
  }
  engine_ = std::move(*engine);
  engine_now_ = engine_.get();
  promise_.set_value(engine_.get());
  probe([this](const Status& status) { finish(status); });
}

/// Returns the job of the probe: one pixel of a light-emitting triangle.
EngineSlot::ProbeJob EngineSlot::probe_job() const {
  Transaction transaction;
  const std::vector<vec3> positions = {{-1, -1, -1}, {1, -1, -1}, {0, 1, -1}};
  auto topology = std::make_shared<MeshTopology>();
  topology->vertex_count = u32(positions.size());
  topology->triangles = ArrayOf<uvec3>(std::vector<uvec3>{{0, 1, 2}});
  auto vertices = std::make_shared<VertexKeys>();
  vertices->times = {0};
  vertices->positions = ArrayOf<vec3>(positions);
  transaction.edits.push_back({.action = PutMesh{topology, vertices}});
  transaction.edits.push_back(
      {.action = PutEntity{.mesh = Ref(CreatedByEdit{0}), .light = LightPatch{}}});
  const Camera camera{.width = 1, .height = 1, .fx = 1, .fy = 1, .cx = 0, .cy = 0};
  transaction.edits.push_back({.action = PutEntity{.camera = camera}});
  auto prepared = apply({.scene = probe_life_}, transaction, SceneLimits{});
  if (!prepared) return std::unexpected(prepared.error());
  auto job = std::make_shared<RenderJob>();
  job->snapshot = prepared->snapshot;
  job->cameras = {EntityId(prepared->ids.at(2))};
  job->planes = {Plane::BEAUTY, Plane::DEPTH};
  job->stop.spp = 1;
  job->origin.tenant = kProbeTenant;
  return job;
}

void EngineSlot::probe(std::function<void(Status)> done) {
  if (!probe_job_) return done(std::unexpected(probe_job_.error()));
  auto sink = std::make_shared<ProbeSink>(done);
  if (auto submitted = engine_now_.load()->submit(*probe_job_, sink, {}); !submitted)
    done(submitted);
}

void EngineSlot::finish(const Status& status) {
  if (!status && !closing_)
    log_.error("the engine does not start", {{"reason", status.error().message}});
  first_(status);
}

Expected<Engine*> EngineSlot::wait() const {
  auto engine = future_.get();
  if (engine) return engine;
  return fail(Code::kUnavailable, "",
              "the render engine could not be started: " + engine.error().message);
}

double retry_seconds(const Engine& engine) {
  return std::max(engine.load().seconds_a_job, kSoonest);
}

}  // namespace heliograph::server
