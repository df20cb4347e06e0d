#include "renderer/frame/label_columns.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstring>
#include <span>
#include <unordered_map>

#include "renderer/scene/motion.h"

namespace heliograph {

namespace {

/// Rows of equal shape, appended value by value.
template <class T>
class Rows {
 public:
  Rows(std::string name, std::vector<u64> row_shape)
      : name_(std::move(name)), shape_(std::move(row_shape)) {}
  void add(T value) { values_.push_back(value); }
  template <class V>
  void add_vector(const V& v) {
    for (int i = 0; i < V::length(); ++i) add(T(v[i]));
  }
  void add_matrix(const glm::dmat4& m) {  // row-major
    for (int row = 0; row < 4; ++row)
      for (int column = 0; column < 4; ++column) add(T(m[column][row]));
  }
  void add_box(const PixelBox& box) {
    for (const i32 v : {box.x0, box.y0, box.x1, box.y1}) add(T(v));
  }
  void finish(u64 rows, std::vector<Column>& columns) const {
    Column column{.name = name_, .dtype = dtype_of<T>(), .shape = {rows}};
    column.shape.insert(column.shape.end(), shape_.begin(), shape_.end());
    const auto bytes = std::as_bytes(std::span(values_));
    column.data.assign(bytes.begin(), bytes.end());
    columns.push_back(std::move(column));
  }

 private:
  std::string name_;
  std::vector<u64> shape_;
  std::vector<T> values_;
};

std::string json_string(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\')
      (out += '\\') += c;
    else if (static_cast<unsigned char>(c) < 0x20)
      out += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    else
      out += c;
  }
  return out + '"';
}

std::string json_object(const Attributes* attributes) {
  std::string out = "{";
  if (attributes)
    for (const auto& [key, value] : *attributes)
      out +=
          fmt::format("{}{}: {}", out.size() > 1 ? ", " : "", json_string(key), json_string(value));
  return out + "}";
}

std::array<vec3, 8> corners(const RestBox& box) {
  std::array<vec3, 8> out;
  for (u32 i = 0; i < 8; ++i)
    out[i] = {i & 1 ? box.upper.x : box.lower.x, i & 2 ? box.upper.y : box.lower.y,
              i & 4 ? box.upper.z : box.lower.z};
  return out;
}

/// Identities of the instances: names, classes, attributes.
void add_identity(const LabelInputs& in, std::vector<Column>& columns) {
  Rows<u32> label("label", {}), category("category", {});
  Rows<u64> entity("entity", {});
  Column name{.name = "name"}, attributes{.name = "attributes"};
  const auto& instances = in.labelling.instances;
  for (const Instance& instance : instances) {
    const Entity& root = in.snapshot.entities.at(instance.root);
    label.add(instance.label);
    category.add(instance.category);
    entity.add(in.snapshot.entity_id(instance.root).value);
    name.strings.push_back(root.name ? *root.name : "");
    attributes.strings.push_back(json_object(root.attributes.get()));
  }
  label.finish(instances.size(), columns);
  category.finish(instances.size(), columns);
  entity.finish(instances.size(), columns);
  columns.push_back(std::move(name));
  columns.push_back(std::move(attributes));
}

/// Poses and 3D boxes.
void add_boxes(const LabelInputs& in, std::vector<Column>& columns) {
  Rows<double> world("world_from_object", {4, 4}), camera("camera_from_object_cv", {4, 4});
  Rows<float> scale("scale", {3}), center("box_center", {3}), half("box_half_extents", {3});
  Rows<float> corners_camera("corners_camera", {8, 3}), corners_image("corners_image", {8, 2});
  Rows<u8> rigid("rigid", {}), crosses("crosses_camera_plane", {});
  const auto& instances = in.labelling.instances;
  for (std::size_t row = 0; row < instances.size(); ++row) {
    const ObjectFrame& frame = in.frames[row];
    const glm::dmat4 camera_from_object = in.camera.camera_from_world_cv * frame.world_from_object;
    const RestBox box = in.boxes[row].empty() ? RestBox{vec3(0), vec3(0)} : in.boxes[row];
    world.add_matrix(frame.world_from_object);
    camera.add_matrix(camera_from_object);
    scale.add_vector(frame.scale);
    rigid.add(frame.rigid);
    center.add_vector((box.lower + box.upper) * 0.5f);
    half.add_vector((box.upper - box.lower) * 0.5f);
    u32 behind = 0;
    for (const vec3& corner : corners(box)) {
      const glm::dvec3 p(camera_from_object * glm::dvec4(glm::dvec3(corner), 1));
      corners_camera.add_vector(p);
      const glm::dvec2 seen = project(in.camera, p);
      corners_image.add_vector(seen);
      behind += std::isnan(seen.x);
    }
    crosses.add(behind > 0 && behind < 8);
  }
  const u64 rows = instances.size();
  for (auto* column : {&world, &camera}) column->finish(rows, columns);
  for (auto* column : {&scale, &center, &half, &corners_camera, &corners_image})
    column->finish(rows, columns);
  for (auto* column : {&rigid, &crosses}) column->finish(rows, columns);
}

struct VisiblePixels {
  u32 count = 0;
  PixelBox box;
};

/// Counts and extents of every label in the instance plane, by row.
std::vector<VisiblePixels> visible_pixels(const LabelInputs& in) {
  std::unordered_map<u32, std::size_t> row_of;
  const auto& instances = in.labelling.instances;
  for (std::size_t row = 0; row < instances.size(); ++row) row_of[instances[row].label] = row;
  std::vector<VisiblePixels> out(instances.size());
  u32 last_label = 0;
  VisiblePixels* last = nullptr;
  for (u32 y = 0, i = 0; y < in.camera.height; ++y)
    for (u32 x = 0; x < in.camera.width; ++x, ++i) {
      const u32 label = in.instance_plane[i];
      if (label == 0) continue;
      if (label != last_label) {
        const auto found = row_of.find(label);
        last = found == row_of.end() ? nullptr : &out[found->second];
        last_label = label;
      }
      if (!last) continue;
      ++last->count;
      last->box.extend(i32(x), i32(y));
    }
  return out;
}

void add_pixels(const LabelInputs& in, std::vector<Column>& columns) {
  Rows<u32> visible("visible", {}), inside("inside", {}), canvas("canvas", {});
  Rows<i32> bbox("bbox_visible", {4}), amodal("bbox_amodal", {4}), outer("bbox_amodal_canvas", {4});
  Rows<float> visibility("visibility", {}), occlusion("occlusion", {}),
      truncation("truncation", {});
  const u64 rows = in.labelling.instances.size();
  const auto seen = visible_pixels(in);
  const auto share = [](u32 part, u32 whole, float none) {
    return whole ? float(double(part) / double(whole)) : none;
  };
  for (std::size_t row = 0; row < rows; ++row) {
    visible.add(seen[row].count);
    bbox.add_box(seen[row].box);
    if (in.silhouettes.empty()) continue;
    const Silhouette& alone = in.silhouettes[row];
    inside.add(alone.inside);
    canvas.add(alone.canvas);
    amodal.add_box(alone.box_inside);
    outer.add_box(alone.box_canvas);
    visibility.add(share(seen[row].count, alone.canvas, 0));
    occlusion.add(1 - share(seen[row].count, alone.inside, 1));
    truncation.add(1 - share(alone.inside, alone.canvas, 1));
  }
  visible.finish(rows, columns);
  bbox.finish(rows, columns);
  if (in.silhouettes.empty()) return;
  for (auto* column : {&inside, &canvas}) column->finish(rows, columns);
  for (auto* column : {&amodal, &outer}) column->finish(rows, columns);
  for (auto* column : {&visibility, &occlusion, &truncation}) column->finish(rows, columns);
}

void add_masks(const LabelInputs& in, std::vector<Column>& columns) {
  const u64 bytes = (u64(in.camera.width) * in.camera.height + 7) / 8;
  Column masks{
      .name = "amodal_masks", .dtype = DType::kU8, .shape = {in.silhouettes.size(), bytes}};
  masks.data.resize(in.silhouettes.size() * bytes);
  for (std::size_t row = 0; row < in.silhouettes.size(); ++row) {
    const auto& mask = in.silhouettes[row].mask;
    std::memcpy(masks.data.data() + row * bytes, mask.data(), mask.size());
  }
  columns.push_back(std::move(masks));
}

void add_keypoints(const LabelInputs& in, std::vector<Column>& columns) {
  Rows<u32> instance("keypoint_instance", {});
  Rows<float> camera("keypoint_position_camera", {3}), image("keypoint_image", {2});
  Rows<u8> state("keypoint_state", {});
  Column name{.name = "keypoint_name"};
  for (const KeypointLabel& keypoint : in.keypoints) {
    instance.add(keypoint.instance);
    name.strings.push_back(keypoint.name);
    camera.add_vector(keypoint.p_camera);
    image.add_vector(keypoint.p_image);
    state.add(u8(keypoint.state));
  }
  const u64 rows = in.keypoints.size();
  instance.finish(rows, columns);
  columns.push_back(std::move(name));
  camera.finish(rows, columns);
  image.finish(rows, columns);
  state.finish(rows, columns);
}

}  // namespace

ObjectFrame object_frame(const mat4x3& world_from_root) {
  const mat3 linear(world_from_root[0], world_from_root[1], world_from_root[2]);
  ObjectFrame frame;
  for (int i = 0; i < 3; ++i) frame.scale[i] = glm::length(linear[i]);
  // Columns at right angles: a rotation times a scale along its own axes.
  float skew = 0;
  for (int i = 0; i < 3; ++i)
    skew = std::max(skew, std::abs(glm::dot(linear[i], linear[(i + 1) % 3])) /
                              (frame.scale[i] * frame.scale[(i + 1) % 3]));
  frame.rigid = skew < 1e-4f && glm::determinant(linear) > 0;
  glm::dmat3 rotation;
  if (frame.rigid) {
    for (int i = 0; i < 3; ++i) rotation[i] = glm::normalize(glm::dvec3(linear[i]));
  } else {
    const glm::dquat nearest(decompose(world_from_root).rotation);
    rotation = glm::mat3_cast(glm::normalize(nearest));
  }
  frame.world_from_object = glm::dmat4(rotation);
  frame.world_from_object[3] = glm::dvec4(glm::dvec3(world_from_root[3]), 1);
  return frame;
}

std::vector<Column> label_columns(const LabelInputs& inputs) {
  std::vector<Column> columns;
  add_identity(inputs, columns);
  add_boxes(inputs, columns);
  if (!inputs.instance_plane.empty()) add_pixels(inputs, columns);
  if (inputs.options.amodal_masks) add_masks(inputs, columns);
  if (inputs.options.keypoints) add_keypoints(inputs, columns);
  return columns;
}

}  // namespace heliograph
