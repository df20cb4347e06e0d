// Rays through the BVH of bvh.h: a walk that can stop between any two steps, and the Tracer made of
// such walks. Used by the CUDA backend, and on the CPU by its tests.
#pragma once

#include "kernels/bvh/bvh_rare.h"
#include "kernels/geometry/exact.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Where a walk puts off what it has to do. It is no part of BvhWalk, so that a compiler can keep
/// that in registers.
struct BvhStack {
  // A group for each level of both trees, the rest of some instances, the ray of the world.
  BvhGroup groups[2 * kBvhDepth + 8];
};

/// Purposes of rays. Labels compare surfaces at nearly the same distance by takes_over().
enum class Answers : u8 { kPictures, kLabels };

/// One ray's walk through a scene. Lifetime: of the views, their arrays, the stack and, for labels,
/// the ray.
///
/// Pictures take, of two surfaces at the same distance, the one of the lower instance, and of one
/// instance the lower primitive, in whatever order they come.
/// Source: Ylitie, Karras and Laine 2017, section 3.3.
template <Answers kFor>
class BvhWalkFor {
 public:
  KERNEL BvhWalkFor(const SceneView& scene, const BvhView& bvh, BvhStack& stack)
      : scene_(&scene), bvh_(&bvh), stack_(stack.groups) {}

  /// The next walk is through another scene.
  KERNEL void go_to(const SceneView& scene, const BvhView& bvh) {
    scene_ = &scene;
    bvh_ = &bvh;
  }

  /// Starts towards the nearest surface that `mask` meets, or, with `any`, towards any of them.
  KERNEL void begin(const Ray& ray, u32 mask, bool any) {
    start(ray, mask, any, is_sound(ray));
    set_space(ray.origin, ray.direction);
    instance_ = kNone;
    set_top();
    const BvhNode* fixed = bvh_->fixed.nodes;
    triangles_ = bvh_->fixed.triangles;
    if (!fixed) {
      if (!tree_) nodes_.bits = 0;
      return;
    }
    if (tree_) {  // comes afterwards, as if the fixed tree were an instance of it
      push(nodes_);
      push_space();
    }
    item_ = kFixed;
    tree_ = fixed;
  }

  /// The same in one instance alone, whatever rays meet it, by a ray of its object space whose
  /// direction has any length.
  KERNEL void begin_object(const Ray& ray_object, u32 instance, bool any) {
    start(ray_object, 0, any, is_sound(ray_object, kFarthest, kFarthest));
    set_space(ray_object.origin, ray_object.direction);
    const u32 item = bvh_->item_of_instance[instance];
    set_item(item);
    if (!(bvh_->items[item].flags & kBvhShape)) return;
    nodes_.bits = 0;
    keep(shape_hit(*scene_, bvh_->items[item], {space_.origin, direction_}));
  }

  /// Does a bounded piece of work: the children of one node with the triangles among them, or the
  /// way into an instance. Returns false when there is nothing left to do.
  KERNEL bool step() {
    const BvhGroup items = take_items();
    if (items.bits != 0) meet(items);
    return goes_on();
  }

  // The parts of a step, for who takes many walks side by side: a part can wait until enough of
  // them need it.

  /// The items among the children of the next node, or those that were put off. None: bits 0.
  KERNEL BvhGroup take_items() {
    const BvhGroup put_off = nodes_;
    if (!has_nodes(nodes_)) {
      nodes_.bits = 0;
      return put_off;
    }
    const u32 number = take_node(nodes_, space_.octant);
    if (has_nodes(nodes_)) push(nodes_);
    const NodeChildren met = meet_children(tree_ + number, space_, hit_.t);
    nodes_ = met.nodes;
    return met.items;
  }
  /// Meets triangles, or enters an instance. Some items.
  KERNEL void meet(const BvhGroup& items) {
    if (item_ == kNone)
      meet_instances(items);
    else if (kRichRays && !triangles_ && has_curves())
      meet_segments(items);
    else
      meet_triangles(items);
  }
  /// True if there is something left to do.
  KERNEL bool goes_on() {
    if (any_ && hit_.instance != kNone) return false;
    return has_nodes(nodes_) || next();
  }

  /// The nearest surface met so far; the answer once step() returned false.
  [[nodiscard]] KERNEL Hit hit() const {
    if (hit_.instance == kNone) return {INFINITY, kNone, kNone, 0, 0};
    if constexpr (kFor == Answers::kLabels)
      return {t_, hit_.instance, hit_.primitive, hit_.u, hit_.v};
    return hit_;
  }

 private:
  KERNEL void start(const Ray& ray, u32 mask, bool any, bool sound) {
    hit_ = {sound ? ray.t_max : -1, kNone, kNone, 0, 0};
    if constexpr (kFor == Answers::kLabels) {
      ray_ = &ray;
      t_ = 0;
    }
    holes_ = ray.holes;
    time_ = ray.time;
    mask_ = mask;
    any_ = any;
    size_ = 0;
    nodes_ = {0, 1u << 31};
  }
  KERNEL void set_space(vec3 origin, vec3 direction) {
    space_ = box_ray(origin, direction);
    direction_ = direction;
  }
  KERNEL void set_item(u32 item) {
    item_ = item;
    tree_ = bvh_->items[item].nodes;
    triangles_ = bvh_->items[item].triangles;
    instance_ = bvh_->items[item].instance;
  }

  KERNEL void set_top() {
    item_ = kNone;
    tree_ = bvh_->top;
  }

  KERNEL void push(const BvhGroup& group) { stack_[size_++] = group; }
  KERNEL void push(float a, float b) { push({bits_of_float(a), bits_of_float(b)}); }
  /// Pushes what leave() takes.
  KERNEL void push_space() {
    push(space_.origin.x, space_.origin.y);
    push(space_.origin.z, direction_.x);
    push(direction_.y, direction_.z);
    push(BvhGroup{0, 0});
  }
  KERNEL vec2 pop_floats() {
    const BvhGroup group = stack_[--size_];
    return {float_of_bits(group.base), float_of_bits(group.bits)};
  }

  /// Goes on with the last group that was put off. Returns whether there is one.
  KERNEL bool next() {
    while (size_ > 0) {
      nodes_ = stack_[--size_];
      if (nodes_.bits != 0) return true;
      leave();
    }
    return false;
  }

  /// The nearer of two hits, see the class.
  KERNEL void keep(const Hit& hit) {
    if (!(hit.t <= hit_.t)) return;
    if constexpr (kFor == Answers::kLabels) {
      keep_label(hit);
      return;
    }
    if (hit.t == hit_.t && (hit.instance > hit_.instance ||
                            (hit.instance == hit_.instance && hit.primitive >= hit_.primitive)))
      return;
    if (kRichRays && scene_->any_holes && is_hole(*scene_, holes_, hit)) return;
    hit_ = hit;
  }

  /// The walk goes on a little beyond the hit, where others may come before it.
  KERNEL void keep_label(const Hit& hit) {
    if (kRichRays && scene_->any_holes && is_hole(*scene_, holes_, hit)) return;
    if (!takes_over(*scene_, *ray_, hit, this->hit())) return;
    hit_ = hit;
    hit_.t *= 1 + kUnclear;
    t_ = hit.t;
  }

  KERNEL void meet_triangles(BvhGroup items) {
    const Across plane = across(direction_, space_.inverse);
    while (items.bits != 0) {
      const u32 bit = highest_bit(items.bits);
      items.bits ^= 1u << bit;
      const u32 i = items.base + bit;
      const BvhTriangle triangle =
          kRichRays && !triangles_
              ? deformed_triangle(*scene_, *bvh_, bvh_->items[item_].mesh, {i, time_})
              : load_triangle(triangles_, i);
      TriangleHit met;
      if (!meet_triangle(triangle, space_.origin, direction_, plane, hit_.t, met)) continue;
      u32 instance = instance_;
      if (instance == kNone) {
        if (!(triangles_[i].visibility & mask_)) continue;
        instance = bvh_->fixed.instances[triangles_[i].member];
      }
      keep({met.t, instance, triangle.number, met.u, met.v});
      if (any_ && hit_.instance != kNone) return;
    }
  }

  /// True if the instance that the walk is in has curves.
  KERNEL bool has_curves() const {
    return scene_->meshes[bvh_->items[item_].mesh].shape == Shape::kCurves;
  }
  KERNEL void meet_segments(BvhGroup items) {
    while (items.bits != 0) {
      const u32 bit = highest_bit(items.bits);
      items.bits ^= 1u << bit;
      keep(segment_hit(*scene_, *bvh_, item_, {items.base + bit, time_},
                       {space_.origin, direction_}));
      if (any_ && hit_.instance != kNone) return;
    }
  }

  /// Meets the shapes among some instances, and enters the first one of another kind; the others
  /// are put off.
  KERNEL void meet_instances(BvhGroup items) {
    while (items.bits != 0) {
      // Items lie in the order of slots: along x the nearer ones come first.
      const u32 lowest = items.bits & (0u - items.bits);
      const u32 bit = highest_bit(space_.octant & 4 ? lowest : items.bits);
      items.bits ^= 1u << bit;
      const u32 item = items.base + bit;
      const BvhInstance& met = bvh_->items[item];
      if (!(met.visibility & mask_)) continue;
      const ObjectRay local =
          kRichRays && met.flags & kBvhMoves
              ? moving_object_ray(*scene_, met.instance, time_, {space_.origin, direction_})
              : object_ray(met, {space_.origin, direction_});
      if (met.flags & kBvhShape) {
        keep(shape_hit(*scene_, met, local));
        if (any_ && hit_.instance != kNone) return;
        continue;
      }
      if (has_nodes(nodes_)) push(nodes_);
      if (items.bits != 0) push(items);
      push_space();
      set_item(item);
      set_space(local.origin, local.direction);
      nodes_ = {0, 1u << 31};
      return;
    }
  }
  /// Back to the world.
  KERNEL void leave() {
    const vec2 dyz = pop_floats(), ozdx = pop_floats(), oxy = pop_floats();
    set_top();
    set_space({oxy.x, oxy.y, ozdx.x}, {ozdx.y, dyz.x, dyz.y});
  }

  static constexpr u32 kFixed = kNone - 1;

  const SceneView* scene_;
  const BvhView* bvh_;
  BvhGroup* stack_;
  const BvhNode* tree_;  // of item_
  const BvhTriangle* triangles_;
  BvhGroup nodes_;  // what comes next: nodes, or instances that were put off
  BoxRay space_;    // the ray in the space of item_
  vec3 direction_;
  Hit hit_;   // t: how far the ray goes still
  u32 item_;  // the instance it is in, a number of BvhView::items; kNone: top; kFixed: fixed
  u32 instance_;
  u32 mask_;
  u32 size_;
  HoleKey holes_;
  float time_;
  bool any_;
  const Ray* ray_;  // for labels: of the world; and how far away the hit is
  float t_;
};
using BvhWalk = BvhWalkFor<Answers::kPictures>;

/// A Tracer on the BVH. Thread: any. Lifetime: of the views and their arrays.
template <Answers kFor>
class BvhTracerFor {
 public:
  KERNEL BvhTracerFor(const SceneView& scene, const BvhView& bvh) : scene_(&scene), bvh_(&bvh) {}

  [[nodiscard]] KERNEL Hit closest(const Ray& ray, u32 mask) const {
    BvhStack stack;
    BvhWalkFor<kFor> walk(*scene_, *bvh_, stack);
    walk.begin(ray, mask, false);
    return finish(walk);
  }
  [[nodiscard]] KERNEL bool occluded(const Ray& ray, u32 mask) const {
    BvhStack stack;
    BvhWalk walk(*scene_, *bvh_, stack);
    walk.begin(ray, mask, true);
    return finish(walk).instance != kNone;
  }
  [[nodiscard]] KERNEL Hit closest_in(u32 instance, const Ray& ray) const {
    const mat4x3 m = pose_at(*scene_, scene_->instances[instance], ray.time).object_from_world;
    Ray local = ray;
    local.origin = transform_point(m, ray.origin);
    local.direction = transform_vector(m, ray.direction);
    BvhStack stack;
    BvhWalk walk(*scene_, *bvh_, stack);
    walk.begin_object(local, instance, false);
    return finish(walk);
  }
  /// True if a ray of object space, its direction of any length, meets one instance alone.
  [[nodiscard]] KERNEL bool meets(u32 instance, const Ray& ray_object) const {
    BvhStack stack;
    BvhWalk walk(*scene_, *bvh_, stack);
    walk.begin_object(ray_object, instance, true);
    return finish(walk).instance != kNone;
  }

 private:
  template <class Walk>
  KERNEL static Hit finish(Walk& walk) {
    while (walk.step()) {
    }
    return walk.hit();
  }

  const SceneView* scene_;
  const BvhView* bvh_;
};

using BvhTracer = BvhTracerFor<Answers::kPictures>;
static_assert(Tracer<BvhTracer>);

}  // namespace heliograph::kernels::inline HELIO_ISA
