// Planes by name, masks, and the picture.
#include "heliograph/frame.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>

#include "heliograph/error.h"

namespace heliograph::client {
namespace {

/// IEC 61966-2-1
std::uint8_t to_srgb(double linear) {
  const double x = std::clamp(linear, 0.0, 1.0);
  const double y = x <= 0.0031308 ? 12.92 * x : 1.055 * std::pow(x, 1 / 2.4) - 0.055;
  return std::uint8_t(y * 255 + 0.5);
}

}  // namespace

Frame::Frame(FrameInfo info, std::vector<Plane> planes, Columns labels)
    : data_(std::make_shared<const Data>(
          Data{std::move(info), std::move(planes), std::move(labels)})) {}

bool Frame::contains(const std::string& plane) const {
  return std::any_of(data_->planes.begin(), data_->planes.end(),
                     [&](const Plane& known) { return known.name == plane; });
}

const Array& Frame::operator[](const std::string& plane) const {
  const Plane* with_argument = nullptr;
  std::size_t count = 0;
  ErrorDetails details;
  std::string have;
  for (const Plane& known : data_->planes) {
    if (known.name == plane) return known.pixels;
    if (plane != "beauty" && known.name.rfind(plane + ":", 0) == 0) {
      with_argument = &known;
      ++count;
    }
    details.nearest.push_back(known.name);
    have += (have.empty() ? "" : ", ") + known.name;
  }
  if (count == 1) return with_argument->pixels;
  throw ClientError(Code::kNotFound,
                    "no plane \"" + plane + "\" among " + (have.empty() ? "none" : have) +
                        "; ask for it with RenderOptions::planes()",
                    std::move(details));
}

std::map<std::uint32_t, std::string> Frame::instances() const {
  std::map<std::uint32_t, std::string> out;
  const auto ids = labels().view<std::uint32_t>("label");
  const auto& names = labels().texts("name");
  for (std::size_t i = 0; i < ids.size(); ++i) out[ids[i]] = names.at(i);
  return out;
}

Array Frame::amodal_mask(std::uint32_t label) const {
  const auto ids = labels().view<std::uint32_t>("label");
  const auto* const found = std::find(ids.begin(), ids.end(), label);
  if (found == ids.end())
    throw ClientError(Code::kNotFound, "no instance has label " + std::to_string(label) +
                                           "; instances() lists them");
  const auto masks = labels().view<std::uint8_t>("amodal_masks");
  const auto row = std::size_t(found - ids.begin());
  std::vector<std::uint8_t> out(std::size_t(width()) * height());
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = (masks(row, i / 8) >> (7 - i % 8)) & 1;
  return {std::move(out), {height(), width()}};
}

Array Frame::image(double exposure) const {
  const Array& beauty = (*this)["beauty"];
  const double factor = std::exp2(exposure);
  std::vector<std::uint8_t> out;
  out.reserve(std::size_t(width()) * height() * 3);
  const auto put = [&](const auto& pixels, auto number) {
    for (const auto& pixel : pixels)
      for (std::size_t c = 0; c < 3; ++c) out.push_back(to_srgb(factor * number(pixel[c])));
  };
  if (beauty.dtype() == DType::kF16)
    put(beauty.view<std::array<Half, 4>>(), [](Half value) { return value.value(); });
  else
    put(beauty.view<std::array<float, 4>>(), [](float value) { return value; });
  return {std::move(out), {height(), width(), 3}};
}

void Frame::save(const std::string& path, double exposure) const {
  const Array picture = image(exposure);
  std::ofstream file(path, std::ios::binary);
  file << "P6\n" << width() << " " << height() << "\n255\n";
  file.write(reinterpret_cast<const char*>(picture.data()), std::streamsize(picture.bytes()));
  if (!file.flush())
    throw ClientError(Code::kFailedPrecondition,
                      "path: cannot write " + path + "; is its folder there?", {"path"});
}

}  // namespace heliograph::client
