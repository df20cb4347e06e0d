// Cost of building a scene's light tree: milliseconds, median and worst.
//  usage: bench_light_tree
#include <algorithm>
#include <chrono>
#include <random>

#include <fmt/format.h>

#include "renderer/lights/light_tree.h"

using namespace heliograph;
using heliograph::kernels::u32;
using heliograph::kernels::vec3;

namespace {

std::vector<kernels::LightBounds> random_lights(u32 count) {
  std::mt19937 engine{5};
  std::uniform_real_distribution<float> place(-10, 10), edge(-0.1f, 0.1f);
  const auto random = [&](auto& of) {
    const float x = of(engine), y = of(engine);
    return vec3(x, y, of(engine));
  };
  std::vector<kernels::LightBounds> lights;
  for (u32 i = 0; i < count; ++i) {
    const vec3 a = random(place), b = a + random(edge), c = a + random(edge);
    lights.push_back(kernels::triangle_bounds(a, b, c));
  }
  return lights;
}

}  // namespace

int main() {
  fmt::print("{:>10} {:>12} {:>12}\n", "lights", "median ms", "worst ms");
  for (const u32 count : {1'000u, 10'000u, 100'000u}) {
    const auto lights = random_lights(count);
    std::vector<double> times;
    for (int round = 0; round < 21; ++round) {
      const auto start = std::chrono::steady_clock::now();
      const auto tree = resident::build_light_tree(lights, 1);
      const std::chrono::duration<double, std::milli> time =
          std::chrono::steady_clock::now() - start;
      if (tree.nodes.size() == 2 * count - 1) times.push_back(time.count());
    }
    std::ranges::sort(times);
    fmt::print("{:>10} {:>12.3f} {:>12.3f}\n", count, times[times.size() / 2], times.back());
  }
}
