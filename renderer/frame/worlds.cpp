// Jobs of worlds, and packing.
#include "renderer/frame/worlds.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cstring>

#include "kernels/core/hash.h"
#include "renderer/scene/labels.h"
#include "renderer/scene/worlds.h"

namespace heliograph {
namespace {

/// Some pictures' part of a plane.
class PartOfPlane final : public PixelMemory {
 public:
  PartOfPlane(Pixels whole, u64 offset, u64 bytes)
      : whole_(std::move(whole)), bytes_(whole_.data() + offset, bytes) {}
  [[nodiscard]] std::span<std::byte> bytes() override { return bytes_; }
  [[nodiscard]] bool is_on_device() const override { return whole_.memory()->is_on_device(); }

 private:
  Pixels whole_;
  const std::span<std::byte> bytes_;
};

/// True if check_job() may judge a world differently from the scene.
bool differs_in_checks(const RenderJob& job, u32 world) {
  return job.worlds->has_overlay(world) || wants_forward(job) || wants_backward(job) ||
         job.disparity_camera;
}

Status check_rule(const RenderJob& job) {
  const auto refuse = [](const char* field) {
    return fail(Code::kInvalidArgument, field,
                "does not go with worlds, whose pictures have equally many samples; set spp");
  };
  if (job.stop.seconds > 0) return refuse("seconds");
  if (job.stop.noise > 0) return refuse("noise");
  if (job.stop.adaptive) return refuse("adaptive");
  if (job.progressive)
    return fail(Code::kInvalidArgument, "progressive",
                "does not go with worlds, which come when all are done; leave it out");
  return {};
}

Status check_sizes(const RenderJob& job, uvec2 size) {
  for (std::size_t i = 0; i < job.cameras.size(); ++i) {
    const uvec2 own = rendered_size(job, job.cameras[i]);
    if (own != size)
      return fail(Code::kInvalidArgument, fmt::format("cameras[{}]", i),
                  fmt::format("is {} x {}, and the first picture is {} x {}; pictures of worlds "
                              "have one size: set width and height",
                              own.x, own.y, size.x, size.y));
  }
  return {};
}

Status too_many(const char* where, u64 needed, u64 available, const std::string& what) {
  Error error{
      .code = Code::kResourceExhausted,
      .message = fmt::format("the worlds have {} {}, {} are allowed; render fewer at a time",
                             needed, what, available),
      .where = where};
  error.needed = needed;
  error.available = available;
  return std::unexpected(std::move(error));
}

/// True if an edit brings what a backend derives data from.
bool brings_assets(const Transaction& overlay) {
  return std::ranges::any_of(overlay.edits, [](const Edit& edit) {
    const auto* settings = std::get_if<PutSettings>(&edit.action);
    return std::holds_alternative<PutMesh>(edit.action) ||
           std::holds_alternative<PutVolume>(edit.action) ||
           std::holds_alternative<Instantiate>(edit.action) || (settings && settings->dome);
  });
}

Column numbers(std::string name) {
  return {.name = std::move(name), .dtype = DType::kU32, .shape = {0}};
}

u64 rows_of(const std::vector<Column>& columns, std::string_view name) {
  const auto found = std::ranges::find(columns, name, &Column::name);
  return found == columns.end() ? 0 : found->shape[0];
}

void append(Column& to, const Column& from) {
  if (!to.shape.empty()) to.shape[0] += from.shape[0];
  to.data.insert(to.data.end(), from.data.begin(), from.data.end());
  to.strings.insert(to.strings.end(), from.strings.begin(), from.strings.end());
}

/// So many rows of one number.
Column repeated(std::string name, u64 rows, u32 value) {
  Column column = numbers(std::move(name));
  column.shape[0] = rows;
  column.data.resize(rows * sizeof value);
  for (u64 i = 0; i < rows; ++i)
    std::memcpy(column.data.data() + i * sizeof value, &value, sizeof value);
  return column;
}

}  // namespace

u64 world_seed(u64 seed, u32 world) { return seed ^ kernels::hash64(world); }

Expected<std::shared_ptr<RenderJob>> job_of_world(const RenderJob& job, u32 world) {
  auto snapshot = world_of(job.snapshot, *job.worlds, world);
  if (!snapshot) return std::unexpected(std::move(snapshot).error().at("worlds"));
  auto made = std::make_shared<RenderJob>(job);
  made->worlds = nullptr;
  made->snapshot = *std::move(snapshot);
  made->settings.seed = world_seed(job.settings.seed, world);
  return made;
}

u32 picture_count(const RenderJob& job) {
  return u32(job.cameras.size()) * (job.worlds ? u32(job.worlds->rendered.size()) : 1);
}

Status check_worlds(const RenderJob& job, const JobLimits& limits) {
  HELIO_TRY(check_rule(job));
  const uvec2 size = rendered_size(job, job.cameras.front());
  HELIO_TRY(check_sizes(job, size));
  const bool has_labels = wants_label_columns(job);
  const u64 common_rows = has_labels ? label_entities(*job.snapshot).instances.size() : 0;
  u64 rows = 0;
  for (const u32 world : job.worlds->rendered) {
    u64 own_rows = common_rows;
    if (differs_in_checks(job, world)) {
      auto own = job_of_world(job, world);
      if (!own) return std::unexpected(std::move(own).error());
      Status checked = check_job(**own, limits);
      if (checked) checked = check_sizes(**own, size);
      if (!checked) {
        Error error = std::move(checked).error();
        error.message = fmt::format("in world {}: {}", world, error.message);
        return std::unexpected(std::move(error));
      }
      if (has_labels) own_rows = label_entities(*(*own)->snapshot).instances.size();
    }
    rows += own_rows * job.cameras.size();
  }
  if (rows > job.labels.max_rows)
    return too_many("labels.max_rows", rows, job.labels.max_rows, "rows of labels");
  const u64 mask_bytes = job.labels.amodal_masks ? rows * ((u64(size.x) * size.y + 7) / 8) : 0;
  if (mask_bytes > limits.mask_bytes)
    return too_many("labels.amodal_masks", mask_bytes, limits.mask_bytes, "bytes of masks");
  return {};
}

std::vector<std::shared_ptr<const Snapshot>> needed_snapshots(const RenderJob& job) {
  std::vector<std::shared_ptr<const Snapshot>> needed{job.snapshot};
  if (!job.worlds) return needed;
  for (const u32 world : job.worlds->rendered)
    if (job.worlds->has_overlay(world) && brings_assets(job.worlds->overlays[world]))
      if (auto made = world_of(job.snapshot, *job.worlds, world))
        needed.push_back(*std::move(made));
  return needed;
}

PackedFrame::PackedFrame(std::shared_ptr<const RenderJob> job) : job_(std::move(job)) {
  pictures_->worlds = job_->worlds->rendered;
  for (const u32 world : pictures_->worlds)
    pictures_->seeds.push_back(world_seed(job_->settings.seed, world));
}

Status PackedFrame::allocate() {
  const uvec2 size = rendered_size(*job_, job_->cameras.front());
  const u64 pixels = u64(picture_count(*job_)) * size.x * size.y;
  for (const Plane plane : job_->planes) {
    if (!job_->on_device) {
      frame_.planes.push_back(new_plane(*job_, plane, pixels));
      continue;
    }
    auto made = new_device_plane(*job_, plane, pixels);
    if (!made) return std::unexpected(std::move(made).error());
    frame_.planes.push_back(*std::move(made));
  }
  placed_.assign(frame_.planes.size(), false);
  return {};
}

PixelAllocator PackedFrame::memory() {
  return [this](Plane plane, u64 bytes) { return place(plane, bytes); };
}

/// Light groups have a plane each, asked for in the order of the job.
std::shared_ptr<PixelMemory> PackedFrame::place(Plane plane, u64 bytes) {
  std::size_t i = 0;
  while (frame_.planes[i].plane != plane || placed_[i]) ++i;
  placed_[i] = true;
  const Pixels& whole = frame_.planes[i].pixels;
  return std::make_shared<PartOfPlane>(whole, whole.size() / picture_count(*job_) * count_, bytes);
}

void PackedFrame::add_labels(std::vector<Column> labels, u32 world, u32 camera) {
  if (labels.empty()) return;
  const u64 rows = rows_of(labels, "label"), keypoints = rows_of(labels, "keypoint_instance");
  labels.push_back(repeated("world", rows, world));
  labels.push_back(repeated("camera", rows, camera));
  if (job_->labels.keypoints) {
    labels.push_back(repeated("keypoint_world", keypoints, world));
    labels.push_back(repeated("keypoint_camera", keypoints, camera));
  }
  for (Column& column : labels) {
    const auto found = std::ranges::find(frame_.labels, column.name, &Column::name);
    if (found == frame_.labels.end())
      frame_.labels.push_back(std::move(column));
    else
      append(*found, column);
  }
}

void PackedFrame::add(Frame picture) {
  const u32 cameras = u32(job_->cameras.size()), camera = count_ % cameras;
  if (count_ < cameras) pictures_->cameras.push_back(picture.camera);
  pictures_->shutters.push_back(picture.shutter);
  pictures_->k.push_back(picture.k);
  pictures_->camera_from_world_cv.push_back(picture.camera_from_world_cv);
  add_labels(std::move(picture.labels), pictures_->worlds[count_ / cameras], camera);
  frame_.samples = std::max(frame_.samples, picture.samples);
  frame_.render_seconds += picture.render_seconds;
  frame_.rays += picture.rays;
  placed_.assign(frame_.planes.size(), false);
  if (count_++ > 0) return;
  frame_.scene = picture.scene;
  frame_.revision = picture.revision;
  frame_.overlay = picture.overlay;
  frame_.width = picture.width;
  frame_.height = picture.height;
  frame_.time = picture.time;
  frame_.label_time = picture.label_time;
  frame_.seed = job_->settings.seed;
  frame_.categories = std::move(picture.categories);
  frame_.denoiser = std::move(picture.denoiser);
  frame_.warnings = std::move(picture.warnings);
}

std::shared_ptr<const Frame> PackedFrame::take() {
  assert(count_ == picture_count(*job_));
  frame_.worlds = std::move(pictures_);
  return std::make_shared<const Frame>(std::move(frame_));
}

}  // namespace heliograph
