// The GPU programs. A thread works on a slot of a wave or on a pixel.
#include "kernels/bvh_tracer.h"
#include "renderer/backend/cuda/launch.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

/// A BvhTracer whose walks are there once.
struct CalledTracer {
  BvhTracer tracer;
  HELIO_CALL __device__ Hit closest(const Ray& ray, u32 mask) const {
    return tracer.closest(ray, mask);
  }
  HELIO_CALL __device__ bool occluded(const Ray& ray, u32 mask) const {
    return tracer.occluded(ray, mask);
  }
  HELIO_CALL __device__ Hit closest_in(u32 instance, const Ray& ray) const {
    return tracer.closest_in(instance, ray);
  }
};

__device__ u32 thread() { return blockIdx.x * blockDim.x + threadIdx.x; }
__device__ u32 threads() { return gridDim.x * blockDim.x; }

/// Adds what all threads of a warp have.
__device__ void add_up(u32 own, u64& sum) {
  for (u32 step = 16; step > 0; step /= 2) own += __shfl_down_sync(0xffffffff, own, step);
  if (threadIdx.x % 32 == 0) atomicAdd(reinterpret_cast<unsigned long long*>(&sum), own);
}

}  // namespace

// Fills free slots with items, and lists all slots that have one.
extern "C" __global__ void __launch_bounds__(kThreads)
    wave_begin(const __grid_constant__ WaveLaunch l) {
  const CalledTracer tracer{{l.shot.scene, l.bvh}};
  const Wave wave(l.shot, l.work, l.wave, tracer);
  const u32 items = items_of(l.work);
  for (u32 slot = thread(); slot < l.slots; slot += threads()) {
    u32 item = l.wave.items[slot];
    while (item == kNone && *static_cast<volatile u32*>(&l.counters->next_item) < items) {
      const u32 taken = atomicAdd(&l.counters->next_item, 1);
      if (taken < items && wave.begin(slot, taken)) l.wave.items[slot] = item = taken;
    }
    if (item != kNone) l.queue[atomicAdd(&l.counters->active, 1)] = slot;
  }
}

extern "C" __global__ void __launch_bounds__(kThreads)
    wave_trace(const __grid_constant__ WaveLaunch l) {
  const BvhTracer tracer(l.shot.scene, l.bvh);
  const u32 active = l.counters->active;
  for (u32 i = thread(); i < active; i += threads()) {
    const u32 slot = l.queue[i];
    const WaveRay ray = l.wave.rays[slot];
    l.wave.hits[slot] = tracer.closest(ray.ray, ray.mask);
  }
}

extern "C" __global__ void __launch_bounds__(kThreads)
    wave_arrive(const __grid_constant__ WaveLaunch l) {
  const CalledTracer tracer{{l.shot.scene, l.bvh}};
  const Wave wave(l.shot, l.work, l.wave, tracer);
  const u32 active = l.counters->active;
  for (u32 i = thread(); i < active; i += threads()) {
    const u32 slot = l.queue[i];
    const Arrival arrival = wave.arrive(slot);
    if (!arrival.goes_on) l.wave.items[slot] = kNone;
    if (arrival.takes_light) l.light_queue[atomicAdd(&l.counters->lights, 1)] = slot;
  }
}

extern "C" __global__ void __launch_bounds__(kThreads)
    wave_light(const __grid_constant__ WaveLaunch l) {
  const BvhTracer tracer(l.shot.scene, l.bvh);
  const Wave wave(l.shot, l.work, l.wave, tracer);
  const u32 lights = l.counters->lights;
  for (u32 i = thread(); i < lights; i += threads()) {
    const u32 slot = l.light_queue[i];
    const Ray ray = l.wave.lights[slot].ray;
    if (!tracer.occluded(ray, kShadowRay)) wave.shine(slot);
  }
}

// The items of all pixels, into the film.
extern "C" __global__ void __launch_bounds__(kThreads)
    wave_fold(const __grid_constant__ WaveLaunch l) {
  const BvhTracer tracer(l.shot.scene, l.bvh);
  const Wave wave(l.shot, l.work, l.wave, tracer);
  const u32 pixels = pixels_of(l.work);
  u32 rays = 0;
  for (u32 i = thread(); i < pixels; i += threads()) rays += wave.fold(i);
  add_up(rays, l.counters->rays);
}

// The centre planes of the pixels of some tiles.
extern "C" __global__ void __launch_bounds__(kThreads)
    probe(const ProbeLaunch* l, WaveWork work, u64* rays) {
  const auto tracer_of = [](const ProbeEnd& end) { return CalledTracer{{end.scene, end.bvh}}; };
  const auto scene_of = [](const ProbeEnd& end) {
    return end.wanted ? ProbeScene{&end.scene, &end.camera, end.camera_jumped} : ProbeScene{};
  };
  const CalledTracer now = tracer_of(l->now), forward = tracer_of(l->forward),
                     backward = tracer_of(l->backward);
  const ProbeContext context{scene_of(l->now), scene_of(l->forward), scene_of(l->backward),
                             l->wants_disparity ? &l->disparity : nullptr, &l->settings};
  u32 traced = 0;
  for (u32 i = thread(); i < pixels_of(work); i += threads()) {
    const ItemPlace at = place_of(l->film, work, i);
    if (at.in_image) traced += probe_pixel(context, now, &forward, &backward, l->film, at.x, at.y);
  }
  add_up(traced, *rays);
}
