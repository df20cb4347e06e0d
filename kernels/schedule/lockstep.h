// Paths side by side: how a CPU runs the path tracer. Every step of every path is that of path.h.
// Paths that take the same step one after the other find its code in the caches, and what they
// read next is asked for before the first of them waits for it.
//
// Tested: tests/unit/lockstep_test.cpp, against render_pixel().
#pragma once

#include <new>

#include "kernels/camera/camera_lanes.h"
#include "kernels/geometry/surface_lanes.h"
#include "kernels/schedule/lockstep_item.h"
#include "kernels/schedule/scatter_lanes.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Samples of some pixels, side by side. They are added to the film in the order in which they
/// began.
template <Tracer T>
class Lockstep {
 public:
  Lockstep(const SceneView& scene, const CameraView& camera, const Settings& settings,
           const T& tracer, const FilmView& film)
      : scene_(scene),
        camera_(camera),
        settings_(settings),
        tracer_(tracer),
        film_(film),
        plain_camera_(is_plain(camera)),
        plain_lights_(has_plain_lights(scene)),
        last_rays_(scene, settings) {
    for (Vertex& v : vertices_) free_[free_count_++] = &v;
  }

  [[nodiscard]] bool is_full() const {
    // Light groups add up in the film, path by path.
    return count_ > 0 && (wants(film_, Plane::BEAUTY_GROUP) || count_ + kPatchPixels > kPaths);
  }

  /// Begins a sample of each pixel of a patch. Their camera rays are traced together.
  void begin(const PixelRect& patch, u32 sample) {
    const u32 first = count_, first_active = active_count_;
    for (u32 y = patch.y0; y < patch.y1; ++y)
      for (u32 x = patch.x0; x < patch.x1; ++x) add(x, y, sample);
    for (u32 i = first; i < count_; ++i) listed_[i - first] = i;
    draw(count_ - first, 1, [](const Item&) -> u32 { return kFilterPair; });
    if (plain_camera_) set_camera_lanes(first);
    CameraRays rays;
    for (u32 i = first; i < count_; ++i) {
      Item& item = items_[i];
      set_out_from_camera(item, i - first);
      if (!(item.path.ray.t_max > 0)) continue;
      set_out(item);
      rays.add(item.path.ray, item.hit);
      active_[active_count_++] = i;
    }
    closest(tracer_, rays);
    prefetch_hits(first_active);
  }

  /// Traces them to their ends. Returns the rays traced.
  u32 run() {
    while (active_count_ > 0) {
      arrive();
      shine();
      trace();
    }
    u32 rays = 0;
    for (u32 i = 0; i < count_; ++i) {
      const Item& item = items_[i];
      write_sample(film_, item.pixel, item.values, (item.sample + 1) % kBlock == 0);
      rays += item.values.rays;
    }
    count_ = 0;
    return rays;
  }

 private:
  static constexpr u32 kPaths = 64;
  static_assert(kPatchPixels <= CameraRays::kMost && kPatchPixels <= kLanes);

  /// camera: as it is at the item's time; means nothing to a path on its way.
  PathContext<T> context(const Item& item, const CameraView& camera) const {
    return {scene_, camera, settings_, tracer_, film_, item.sampler, item.time, item.pixel};
  }
  PathContext<T> context(const Item& item) const { return context(item, camera_); }

  void add(u32 x, u32 y, u32 sample) {
    Item& item = items_[count_++];
    item.key = pixel_key(settings_.seed, x, y);
    item.pixel = u64(y) * film_.width + x;
    item.x = x;
    item.y = y;
    item.sample = sample;
    item.sampler = Sampler(item.key, sample, &item.numbers);
    static_cast<SamplePlain&>(item.values) = {};
  }

  /// Draws `pairs` pairs, from first(item) on, for the first `count` of listed_.
  template <class First>
  void draw(u32 count, u32 pairs, const First& first) {
    for (u32 begin = 0; begin < count; begin += kLanes) {
      SamplerLanes lanes;
      for (u32 i = 0; i < kLanes; ++i) {
        Item& item = items_[listed_[min2(begin + i, count - 1)]];
        lanes.pixel_key[i] = item.key;
        lanes.sample[i] = item.sample;
        lanes.first[i] = first(item);
        lanes.to[i] = &item.numbers;
      }
      kernels::draw(lanes, pairs);
    }
  }

  void set_camera_lanes(u32 first) {
    for (u32 i = first; i < count_; ++i) {
      const Item& item = items_[i];
      const u32 lane = i - first;
      const vec2 u = item.sampler.get2(kFilterPair);
      camera_rays_.x.of[lane] = float(item.x);
      camera_rays_.y.of[lane] = float(item.y);
      camera_rays_.u.of[lane] = u.x;
      camera_rays_.v.of[lane] = u.y;
    }
    set_rays(camera_, settings_.filter, camera_rays_);
  }
  /// lane: the item's, of a plain camera
  void set_out_from_camera(Item& item, u32 lane) {
    item.time = path_time(camera_, item.sampler, item.x, item.y);
    if (plain_camera_) {
      const PathContext<T> c = context(item);
      const Ray ray{camera_rays_.origin.get(lane), camera_rays_.direction.get(lane),
                    camera_rays_.end.of[lane], item.time, hole_key(c, kHoleHash)};
      new (&item.path) Path(begin_sample(c, ray, item.values));
      return;
    }
    const CameraAt now(camera_, item.time);
    const PathContext<T> c = context(item, now.camera());
    new (&item.path) Path(begin_sample(c, first_ray(c, item.x, item.y), item.values));
  }

  void set_out(Item& item) {
    if (has_media(scene_)) item.reach = kernels::set_out(context(item), item.path);
  }

  void trace() {
    u32 left = 0;
    for (u32 i = 0; i < active_count_; ++i) {
      Item& item = items_[active_[i]];
      set_out(item);
      const Ray& ray = item.path.ray;
      if (item.seeks == Seeks::kSurface) {
        new (&item.hit) Hit(tracer_.closest(ray, item.path.mask));  // no copy
      } else if (item.seeks == Seeks::kNothing || tracer_.occluded(ray, item.path.mask)) {
        ++item.values.rays;
        continue;
      } else {
        item.hit = {INFINITY, kNone, 0, 0, 0};
      }
      active_[left++] = active_[i];
    }
    active_count_ = left;
    prefetch_hits(0);
  }
  /// The rays of active_, from `first` on, have met something, or nothing: asks for what is needed
  /// where they did.
  void prefetch_hits(u32 first) {
    u32 met = 0, missed = 0;
    for (u32 i = first; i < active_count_; ++i) {
      Item& item = items_[active_[i]];
      item.numbers.count = 0;
      if (item.hit.instance == kNone) {
        missed_[missed++] = active_[i];
        continue;
      }
      prefetch_triangle(scene_, item.hit);
      listed_[met++] = active_[i];
    }
    if (scene_.dome.texture != kNone) look_at_dome(missed);
    for (u32 i = 0; i < met; ++i) prefetch_corners(scene_, items_[listed_[i]].hit);
    draw(met, kVertexPairs, [](const Item& item) { return vertex_pair(item.path, 0); });
  }

  /// For the first `count` of missed_.
  void look_at_dome(u32 count) {
    Vec3<Floats> direction{0};
    for (u32 begin = 0; begin < count; begin += kLanes) {
      const u32 end = min2(begin + kLanes, count);
      for (u32 i = begin; i < end; ++i)
        put(direction, i - begin, items_[missed_[i]].path.ray.direction);
      const DomePlaceOf<Floats> places = dome_place(scene_.dome, direction);
      for (u32 i = begin; i < end; ++i) {
        DomePlace& sky = items_[missed_[i]].sky;
        sky = {get(places.uv, i - begin), get(places.sine, i - begin)};
        prefetch_dome(scene_, sky);
      }
    }
  }

  /// Keeps those that go on active, and lists those whose light waits in lit_.
  void arrive() {
    u32 left = 0;
    lit_count_ = 0;
    u32 met = 0;
    for (u32 i = 0; i < active_count_; ++i) {
      const u32 index = active_[i];
      items_[index].light.ray.t_max = 0;
      if (items_[index].hit.instance == kNone)
        arrive(index, *free_[--free_count_], left);
      else
        listed_[met++] = index;
    }
    for (u32 begin = 0; begin < met; begin += kLanes) {
      HitLanes hits;
      Vertex* vertices[kLanes];
      for (u32 i = begin; i < met && hits.count < kLanes; ++i) {
        const Item& item = items_[listed_[i]];
        Vertex& v = *free_[--free_count_];
        vertices[hits.count] = &v;
        hits.hits[hits.count] = &item.hit;
        hits.times[hits.count] = item.time;
        hits.to[hits.count++] = &v.surface;
      }
      surfaces_at(scene_, hits);
      for (u32 i = 0; i < hits.count; ++i) arrive(listed_[begin + i], *vertices[i], left);
    }
    if (opaque_.count > 0) scatter(opaque_, left);
    for (ScatterLanes<Features::kAll>& lanes : others_)
      if (lanes.count > 0) scatter(lanes, left);
    active_count_ = left;
  }
  /// v   free; holds the surface if the item has met one
  void arrive(u32 index, Vertex& v, u32& left) {
    Item& item = items_[index];
    const PathContext<T> c = context(item);
    const Met met = kernels::arrive(
        c, item.path, item.reach, item.hit, v, item.values, [](const Vertex&) {}, &item.sky);
    if (met != Met::kSurface) {
      free_[free_count_++] = &v;
      queue_next(index, met == Met::kPassage, left);
      return;
    }
    const Company company = company_of(v.material, v.surface.material->thin_walled);
    if (company == Company::kOpaque)
      join(opaque_, v, index, left);
    else
      join(others_[u32(company) - 1], v, index, left);
  }
  template <Features S>
  void join(ScatterLanes<S>& lanes, Vertex& v, u32 index, u32& left) {
    const u32 lane = lanes.count++;
    lanes.items[lane] = index;
    lanes.paths[lane] = &items_[index].path;
    lanes.numbers[lane] = &items_[index].numbers;
    lanes.values[lane] = &items_[index].values;
    lanes.vertices[lane] = &v;
    if (lanes.count == kLanes) scatter(lanes, left);
  }
  /// scatter() of path.h, in lanes.
  template <Features S>
  void scatter(ScatterLanes<S>& lanes, u32& left) {
    read(scene_, settings_, lanes);
    BsdfOf<Floats, S> bsdf;
    CasterConesOf<Floats> casters;
    const Mask all = first_lanes(lanes.count);
    const Mask scattering =
        all & set_scattering(scene_, lanes.material, lanes.at, lanes.p, lanes.looks, bsdf, casters);
    const Mask lit =
        has_lights(scene_) ? scattering & !lanes.is_last & has_smooth_lobe(bsdf) : Mask(false);
    const LitPointOf<Floats> point{lanes.p, receiving_normal(bsdf), receives_below(bsdf), false};
    const Floats surfaces = surface_share(scene_, point);
    // Opaque surfaces stay in lanes, unless lights are sampled one by one.
    const bool alone = S == Features::kAll || !plain_lights_;
    for (u32 i = 0; i < lanes.count; ++i) {
      Vertex& v = *lanes.vertices[i];
      v.bsdf.ng = get(bsdf.ng, i);
      if (!alone) continue;
      get_frame(bsdf, i, v.bsdf);
      set_receiver(v, get(lanes.time, i));
      v.receiver.surface_share = get(surfaces, i);
    }
    if (any(lit)) take_lights(lanes, bsdf, casters, point, surfaces, lit);
    const DirectionOf<Floats> to = choose_direction(bsdf, casters, lanes.material.subsurface_color,
                                                    lanes.carried, lanes.roulette, lanes.chance.x,
                                                    lanes.scatter, [&] { return lanes.chance.y; });
    const u32 goes_on = kernels::follow(lanes, bsdf, surfaces, to, bits_of(scattering),
                                        [&](u32 i) { return context(items_[lanes.items[i]]); });
    for (u32 i = 0; i < lanes.count; ++i) {
      queue_next(lanes.items[i], goes_on >> i & 1, left);
      free_[free_count_++] = lanes.vertices[i];
    }
    lanes.count = 0;
  }
  template <Features S>
  void take_lights(const ScatterLanes<S>& lanes, const BsdfOf<Floats, S>& bsdf,
                   const CasterConesOf<Floats>& casters, const LitPointOf<Floats>& point,
                   Floats surfaces, Mask lit) {
    SampledLights lights;
    const LightChoiceOf<Floats> choices = choose_light(scene_, point, surfaces, lit, lanes.light.x);
    lights.alone = plain_lights_ ? lit & takes_sides(scene_, point) : lit;
    if (plain_lights_) {
      new (&lights.lanes)
          LightLanes(sample_plain_lights(scene_, point, choices, surfaces, lanes.light));
      prefetch_sky(scene_, lights.lanes, lanes.count);
    } else {
      lights.lanes = {};
    }
    if (any(lights.alone)) sample_each(scene_, lanes, choices, lights);
    const LightDirectionOf<Floats>& to = lights.lanes.to;
    const BsdfValueOf<Floats> f = scattered(bsdf, casters, to.direction, to.visibility);
    const TakenLightOf<Floats> taken =
        take_light(to, f, offset_point(lanes.p, bsdf.ng, lanes.offset, to.direction));
    const Mask found = lit & (to.pdf > 0) & taken.counts;
    const u32 bits = bits_of(found);
    Vec3<Floats> carried = lanes.carried.throughput, radiance(0);
    const bool are_plain = scene_.dome.texture == kNone && !any(lights.alone);
    if (are_plain) radiance = plain_radiance(scene_, lights.lanes);
    for (u32 i = 0; i < lanes.count; ++i) {
      if (!(bits >> i & 1)) continue;
      const Item& item = items_[lanes.items[i]];
      if (!are_plain) put(radiance, i, light_radiance(scene_, get(lights, i, item.time)));
      if constexpr (S == Features::kAll) {
        const vec3 color =
            color_towards(context(item), item.path, *lanes.vertices[i], get(to.direction, i));
        put(carried, i, item.path.throughput * color);
      }
    }
    LaterLight unused;  // of lanes that hold none
    aim(taken, found, contribution(taken, carried, radiance), lanes.time,
        [&](u32 i) { return i < lanes.count ? &items_[lanes.items[i]].light : &unused; });
    for (u32 i = 0; i < lanes.count; ++i) {
      if (!(bits >> i & 1)) continue;
      Item& item = items_[lanes.items[i]];
      send_taken(
          context(item), item.path, *lanes.vertices[i], get(lights, i, item.time),
          [&] { return get(taken, i); }, item.values, item.light);
    }
  }
  void queue_next(u32 index, bool goes_on, u32& left) {
    Item& item = items_[index];
    if (item.light.ray.t_max > 0) lit_[lit_count_++] = index;
    if (!goes_on || !(item.path.ray.t_max > 0)) return;
    item.seeks = last_rays_.of(item.path);
    active_[left++] = index;
  }

  void shine() {
    for (u32 i = 0; i < lit_count_; ++i) {
      Item& item = items_[lit_[i]];
      kernels::shine(context(item), item.light, item.values);
    }
  }

  const SceneView& scene_;
  const CameraView& camera_;
  const Settings& settings_;
  const T& tracer_;
  const FilmView& film_;
  const bool plain_camera_, plain_lights_;
  const LastRays last_rays_;
  Item items_[kPaths];
  u32 active_[kPaths];  // items on their way
  u32 lit_[kPaths];
  u32 listed_[kPaths];  // items that numbers are drawn for
  u32 missed_[kPaths];  // items whose rays met nothing
  // Lanes that hold no path are computed, too, and what they read must be there: they begin as
  // zeros.
  CameraLanes camera_rays_{};
  ScatterLanes<Features::kOpaque> opaque_;
  ScatterLanes<Features::kAll> others_[kCompanies - 1];
  // One for each path that waits in lanes, and for each of a group that arrives.
  static constexpr u32 kVertices = kCompanies * (kLanes - 1) + kLanes;
  Vertex vertices_[kVertices];
  Vertex* free_[kVertices];
  u32 free_count_ = 0;
  u32 count_ = 0, active_count_ = 0, lit_count_ = 0;
};

/// Adds samples [first_sample, first_sample + sample_count) of the pixels of a rectangle, whose
/// corner is that of a patch, to the film; returns rays traced.
template <Tracer T>
KERNEL u64 render_rect(const SceneView& scene, const CameraView& camera, const Settings& settings,
                       const T& tracer, const FilmView& film, const PixelRect& rect,
                       u32 first_sample, u32 sample_count) {
  Lockstep<T> paths(scene, camera, settings, tracer, film);
  u64 rays = 0;
  for (u32 y = rect.y0; y < rect.y1; y += kPatchHeight) {
    for (u32 x = rect.x0; x < rect.x1; x += kPatchWidth) {
      const PixelRect patch{x, y, min2(x + kPatchWidth, rect.x1), min2(y + kPatchHeight, rect.y1)};
      for (u32 i = first_sample; i < first_sample + sample_count; ++i) {
        paths.begin(patch, i);
        if (paths.is_full()) rays += paths.run();
      }
    }
  }
  return rays + paths.run();
}

}  // namespace heliograph::kernels::inline HELIO_ISA
