// The settings file of --config, as CLI11 reads it. Called by config.cpp.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace heliograph::server {

/// TOML: the keys are the flags' names without dashes; the table [limits] has the limits. Values
/// are strings, numbers, booleans, and one-line lists of them.
class ConfigFile final : public CLI::ConfigTOML {
 public:
  /// limits   receives the file's limits as "NAME=VALUE", in file order
  ConfigFile(const CLI::App& app, std::vector<std::string>& limits) : app_(app), limits_(limits) {}

  /// Throws CLI::ConfigError, which names the key, for an unknown or repeated setting.
  [[nodiscard]] std::vector<CLI::ConfigItem> from_config(std::istream& input) const override;

 private:
  void check(const CLI::ConfigItem& item) const;

  const CLI::App& app_;
  std::vector<std::string>& limits_;
};

}  // namespace heliograph::server
