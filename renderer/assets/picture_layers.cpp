#include "renderer/assets/picture_layers.h"

#include <OpenImageIO/strutil.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>
#include <ranges>

#include "renderer/assets/bundle.h"
#include "renderer/assets/refuse.h"

namespace heliograph::assets {
namespace {

struct Channel {
  std::string_view layer, name;  // "View Layer.Combined", "R"
};

Channel channel_of(std::string_view full) {
  const std::size_t dot = full.rfind('.');
  if (dot == std::string_view::npos) return {"", full};
  return {full.substr(0, dot), full.substr(dot + 1)};
}

class Channels {
 public:
  explicit Channels(const std::vector<std::string>& names) {
    for (const std::string& name : names) channels_.push_back(channel_of(name));
  }

  [[nodiscard]] std::optional<u32> find(std::string_view layer, std::string_view name) const {
    for (u32 i = 0; i < channels_.size(); ++i) {
      if (channels_[i].layer == layer && OIIO::Strutil::iequals(channels_[i].name, name)) return i;
    }
    return std::nullopt;
  }

  /// All of these, with the layer's alpha; none if one is not there.
  [[nodiscard]] std::vector<u32> all(std::string_view layer,
                                     std::initializer_list<std::string_view> names) const {
    std::vector<u32> found;
    for (const std::string_view name : names) {
      if (const auto channel = find(layer, name)) found.push_back(*channel);
    }
    if (found.size() != names.size()) return {};
    if (const auto alpha = find(layer, "A")) found.push_back(*alpha);
    return found;
  }
  [[nodiscard]] std::vector<u32> colors(std::string_view layer) const {
    std::vector<u32> found = all(layer, {"R", "G", "B"});
    return found.empty() ? all(layer, {"Y"}) : found;
  }

  [[nodiscard]] std::vector<u32> of(std::string_view layer) const {
    std::vector<u32> found;
    for (u32 i = 0; i < channels_.size(); ++i) {
      if (channels_[i].layer == layer) found.push_back(i);
    }
    return found;
  }
  /// In the file's order.
  [[nodiscard]] std::vector<std::string> layers() const {
    std::vector<std::string> found;
    for (const Channel& channel : channels_) {
      const std::string layer(channel.layer);
      if (!layer.empty() && std::ranges::find(found, layer) == found.end()) found.push_back(layer);
    }
    return found;
  }
  /// The first with R, G and B, else the first with Y; "": none.
  [[nodiscard]] std::string first_layer() const {
    const std::vector<std::string> all = layers();
    for (const std::size_t least : {3u, 1u}) {
      const auto has = [&](const std::string& layer) { return colors(layer).size() >= least; };
      const auto found = std::ranges::find_if(all, has);
      if (found != all.end()) return *found;
    }
    return {};
  }
  [[nodiscard]] std::size_t size() const { return channels_.size(); }

 private:
  std::vector<Channel> channels_;
};

std::string counted(const std::vector<std::string>& names) {
  return fmt::format("{} ({})", names.size(), listed(names));
}

Selection of_layer(const Channels& channels, const std::vector<std::string>& names,
                   std::string_view layer, const std::string& where) {
  if (auto colors = channels.colors(layer); !colors.empty()) return {std::move(colors), ""};
  auto all = channels.of(layer);
  if (!all.empty() && all.size() <= 4) return {std::move(all), ""};
  const auto own = std::ranges::find(names, layer);
  if (own != names.end()) return {{u32(own - names.begin())}, ""};
  refuse(where, fmt::format("has no layer '{}'; its channels are {}", clean_name(layer, ""),
                            listed(names)));
}

Selection of_colors(const Channels& channels, const std::vector<std::string>& names,
                    const std::string& where) {
  if (auto xyz = channels.all("", {"X", "Y", "Z"}); !xyz.empty()) {
    return {std::move(xyz), "its channels X, Y, Z are taken as red, green and blue"};
  }
  if (auto colors = channels.colors(""); !colors.empty()) return {std::move(colors), ""};
  if (channels.size() == 1) return {{0}, ""};
  if (const std::string layer = channels.first_layer(); !layer.empty()) {
    return {channels.colors(layer), fmt::format("its layer '{}' is taken of {}; choose with layer=",
                                                clean_name(layer, ""), counted(channels.layers()))};
  }
  auto rest = channels.of("");
  if (rest.empty() || rest.size() > 4) {
    refuse_unimplemented(where, fmt::format("has no channels R, G, B or Y but {}; choose one, or a "
                                            "layer, with layer=",
                                            counted(names)));
  }
  return {std::move(rest), fmt::format("its channels {} are taken as they are", listed(names))};
}

}  // namespace

std::string listed(const std::vector<std::string>& names) {
  constexpr std::size_t kMost = 12;
  const auto cleaned = [](const std::string& name) { return clean_name(name, "?"); };
  const auto first = names | std::views::take(kMost) | std::views::transform(cleaned);
  const std::string text = fmt::format("{}", fmt::join(first, ", "));
  return names.size() <= kMost ? text : fmt::format("{} and {} more", text, names.size() - kMost);
}

Selection select_channels(const std::vector<std::string>& names, std::string_view layer,
                          const std::string& where) {
  const Channels channels(names);
  return layer.empty() ? of_colors(channels, names, where)
                       : of_layer(channels, names, layer, where);
}

}  // namespace heliograph::assets
