// Many samples side by side, a step at a time: how a GPU runs the path tracer. Every step of every
// path is that of path.h; here is what goes on between two of them.
//
// An item is one sample of one pixel, with a path of its own. Who runs a wave begins all items,
// then traces the rays of those that go on, those of light from the round before among them, lets
// them arrive, and again; when none goes on it folds them into the film, in the order of the
// samples.
//
// Source: Laine, Karras and Aila 2013, "Megakernels Considered Harmful: Wavefront Path Tracing on
// GPUs". Tested: tests/unit/wave_test.cpp, against render_pixel().
#pragma once

#include "kernels/schedule/wave_items.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Picture that is rendered.
struct ShotView {
  SceneView scene;
  CameraView camera;
  Settings settings;
  FilmView film;
};

/// True if plain programs render it, see kRich.
KERNEL bool is_plain(const ShotView& shot) {
  const SceneView& scene = shot.scene;
  const FilmView& film = shot.film;
  return !scene.any_rich && !scene.any_curves && !scene.any_media && scene.volume_count == 0 &&
         !film.catcher && (film.wanted & kRichPlaneSet) == 0;
}

/// A batch of items: samples [first_sample, first_sample + samples) of the pixels of some tiles.
/// Items of one sample follow each other, tile by tile. Of several pictures of one size, the tiles
/// of each follow those of the one before.
struct WaveWork {
  u32 first_tile;
  u32 tiles;
  u32 first_sample;
  u32 samples;
};
KERNEL u32 pixels_of(const WaveWork& work) { return work.tiles * kTilePixels; }
KERNEL u32 items_of(const WaveWork& work) { return pixels_of(work) * work.samples; }

/// Picture that an item is of, `image` being any of them.
KERNEL u32 picture_of(const FilmView& image, const WaveWork& work, u32 item) {
  return (work.first_tile + item % pixels_of(work) / kTilePixels) / tiles_of(image);
}

/// Place of an item in its picture.
struct ItemPlace {
  u32 x, y;
  u32 sample;
  bool in_image;
};
KERNEL ItemPlace place_of(const FilmView& image, const WaveWork& work, u32 item) {
  const u32 pixels = pixels_of(work);
  const u32 in_tiles = item % pixels;
  const u32 in_tile = in_tiles % kTilePixels;
  const u32 tile = (work.first_tile + in_tiles / kTilePixels) % tiles_of(image);
  const u32 across = tiles_across(image);
  const u32 x = tile % across * kTileSide + in_tile % kTileSide;
  const u32 y = tile / across * kTileSide + in_tile / kTileSide;
  return {x, y, work.first_sample + item / pixels, x < image.width && y < image.height};
}

/// Outcome of a path's arrival.
struct Arrival {
  bool goes_on;           // it has set out again
  bool wants_shadow_ray;  // if the ray in WaveView::lights is free
};

/// The steps of a wave's items, or of those of one picture among several. No two at a time are of
/// one item.
template <Tracer T>
class Wave {
 public:
  KERNEL Wave(const ShotView& shot, const WaveWork& work, const WaveView& view, const T& tracer)
      : shot_(shot), work_(work), view_(view), tracer_(tracer) {}

  /// False where the item is done at once.
  KERNEL bool begin(u32 item) const {
    const ItemPlace at = place_of(shot_.film, work_, item);
    if (!at.in_image) return false;
    const Sampler sampler = sampler_of(at);
    const float time = path_time(shot_.camera, sampler, at.x, at.y);
    const CameraAt now(shot_.camera, time);
    const PathContext<T> c{shot_.scene, now.camera(), shot_.settings, tracer_,
                           view_.film,  sampler,      time,           item};
    SampleValues sample;
    Path path = begin_sample(c, first_ray(c, at.x, at.y), sample);
    const bool sets_out = path.ray.t_max > 0;
    if (kRich || !sets_out) {
      put(sample, item);
      put_first(sample, item);
    }
    if (sets_out) keep_path(c, item, path);
    return sets_out;
  }
  /// The item's ray has met its hit.
  HELIO_ALWAYS_INLINE KERNEL Arrival arrive(u32 item) const {
    Path path;
    static_cast<PathState&>(path) = load_whole(view_.paths[item]);
    static_cast<PathRay&>(path) = load_whole(view_.rays[item]);
    path.route = route_of(2 * item);
    Reach reach{path.ray.t_max, {INFINITY, vec3(0)}};
    if (kRich && view_.insides) {
      path.inside = view_.insides[item];
      reach = view_.reaches[item];
    }
    const ItemPlace at = place_of(shot_.film, work_, item);
    const PathContext<T> c = context(item, sampler_of(at), path.ray.time);
    SampleValues sample;
    // A plain program lets a path arrive with its first edge just once, and begins its sample then.
    const bool is_first = !kRich && path.edges == 1;
    const bool has_first = is_first || kRich || !path.guided;
    if (is_first) {
      sample.alpha = 1;
    } else {
      get(sample, item);
      if (has_first) get_first(sample, item);
    }
    LaterLight light;
    light.ray.t_max = 0;
    const Hit hit = load_whole(view_.hits[item]).hit;
    const bool goes_on = advance(c, path, reach, hit, sample, &light) && path.ray.t_max > 0;
    put(sample, item);
    if (has_first) put_first(sample, item);
    if (light.ray.t_max > 0) keep_light(item, light);
    if (goes_on) keep_path(c, item, path);
    return {goes_on, light.ray.t_max > 0};
  }
  /// Nothing is in the way of the item's light. Before its path arrives again.
  KERNEL void shine(u32 item) const {
    const WaveLight kept = load_whole(view_.lights[item]);
    SampleValues sample;
    get(sample, item);
    collect(context(item, Sampler(0, 0), 0), sample,
            {kept.radiance, kept.edges, bool(kept.environment), kept.group},
            route_of(2 * item + 1));
    put(sample, item);
  }
  /// Adds all items of pixel `index` of the work to its film. Returns the rays traced for them.
  KERNEL u32 fold(u32 index) const {
    const u32 pixels = pixels_of(work_);
    u32 rays = 0;
    for (u32 i = 0; i < work_.samples; ++i) {
      const u32 item = i * pixels + index;
      const ItemPlace at = place_of(shot_.film, work_, item);
      if (!at.in_image) return 0;
      const u64 pixel = u64(at.y) * shot_.film.width + at.x;
      SampleValues sample;
      get(sample, item);
      get_first(sample, item);
      if (wants(shot_.film, Plane::BEAUTY_GROUP)) fold_groups(item, pixel);
      write_sample(shot_.film, pixel, sample, (at.sample + 1) % kBlock == 0);
      rays += sample.rays;
    }
    return rays;
  }

 private:
  KERNEL Sampler sampler_of(const ItemPlace& at) const {
    return {pixel_key(shot_.settings.seed, at.x, at.y), at.sample};
  }
  /// Context of a path on its way, for which the camera means nothing.
  KERNEL PathContext<T> context(u32 item, const Sampler& sampler, float time) const {
    return {shot_.scene, shot_.camera, shot_.settings, tracer_, view_.film, sampler, time, item};
  }
  KERNEL void keep_path(const PathContext<T>& c, u32 item, Path& path) const {
    const Reach reach = set_out(c, path);
    if (kRich && view_.insides) {
      view_.insides[item] = path.inside;
      view_.reaches[item] = reach;
    }
    store_whole<PathState>(view_.paths[item], path);
    store_whole<PathRay>(view_.rays[item], path);
    keep_route(2 * item, path.route);
  }
  KERNEL void keep_light(u32 item, const LaterLight& later) const {
    const Contribution& light = later.light;
    store_whole(view_.lights[item],
                WaveLight{later.ray, light.radiance, light.group, light.edges, light.environment});
    keep_route(2 * item + 1, later.route);
  }
  KERNEL void keep_route(u32 i, const Route& route) const {
    if (!is_rich()) return;
    store_whole(view_.routes[i], WaveRoute{route.diffuse_share, u32(route.vertex)});
  }
  [[nodiscard]] KERNEL Route route_of(u32 i) const {
    if (!is_rich()) return {vec3(0), FirstVertex::kReflects};
    const WaveRoute kept = load_whole(view_.routes[i]);
    return {kept.diffuse_share, FirstVertex(kept.vertex)};
  }
  KERNEL void put_first(const SampleValues& s, u32 item) const {
    store_whole(view_.firsts[item], WaveFirst{s.albedo, s.alpha, s.normal, s.hit, s.caught});
  }
  KERNEL void get_first(SampleValues& sample, u32 item) const {
    const WaveFirst first = load_whole(view_.firsts[item]);
    sample.albedo = first.albedo;
    sample.alpha = first.alpha;
    sample.normal = first.normal;
    sample.caught = first.caught;
    sample.hit = first.hit != 0;
  }
  KERNEL void put(const SampleValues& sample, u32 item) const {
    store_whole(view_.samples[item], WaveSample{sample.radiance, sample.rays});
    if (is_rich()) store_whole<SampleRich>(view_.riches[item], sample);
  }
  KERNEL void get(SampleValues& sample, u32 item) const {
    const WaveSample kept = load_whole(view_.samples[item]);
    sample.radiance = kept.radiance;
    sample.rays = kept.rays;
    if (is_rich()) static_cast<SampleRich&>(sample) = load_whole(view_.riches[item]);
  }
  [[nodiscard]] KERNEL bool is_rich() const { return kRich && view_.riches; }
  KERNEL void fold_groups(u32 item, u64 pixel) const {
    const float* from = view_.film.partial[u32(Plane::BEAUTY_GROUP)] + u64(item) * 3;
    float* to = shot_.film.partial[u32(Plane::BEAUTY_GROUP)] + pixel * 3;
    for (u32 group = 0; group < shot_.film.groups; ++group) {
      for (u32 i = 0; i < 3; ++i) to[i] += from[i];
      from += u64(view_.film.width) * view_.film.height * 3;
      to += u64(shot_.film.width) * shot_.film.height * 3;
    }
  }

  const ShotView& shot_;
  const WaveWork& work_;
  const WaveView& view_;
  const T& tracer_;
};

}  // namespace heliograph::kernels::inline HELIO_ISA
