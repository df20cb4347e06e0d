// The settings file of --config, as CLI11 reads it. Called by config.cpp.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace heliograph::server {

/// TOML: the flags' names without their dashes are the keys; the table [limits] has the limits.
/// Strings, numbers, true and false, and lists of them on one line.
class ConfigFile final : public CLI::ConfigTOML {
 public:
  /// limits: gets the file's, as "NAME=VALUE", in the order in which they stand there.
  ConfigFile(const CLI::App& app, std::vector<std::string>& limits) : app_(app), limits_(limits) {}

  /// Throws CLI::ConfigError, which names the key, when there is no such setting or it stands there
  /// twice.
  [[nodiscard]] std::vector<CLI::ConfigItem> from_config(std::istream& input) const override;

 private:
  void check(const CLI::ConfigItem& item) const;

  const CLI::App& app_;
  std::vector<std::string>& limits_;
};

}  // namespace heliograph::server
