// See config_file.h.
#include "server/config/config_file.h"

#include <set>

namespace heliograph::server {
namespace {

constexpr const char* kLimits = "limits";

/// CLI11 marks where a table begins and ends.
bool is_mark(const CLI::ConfigItem& item) { return item.name == "++" || item.name == "--"; }

}  // namespace

void ConfigFile::check(const CLI::ConfigItem& item) const {
  const CLI::Option* option =
      item.parents.empty() ? app_.get_option_no_throw("--" + item.name) : nullptr;
  if (option == nullptr || !option->get_configurable())
    throw CLI::ConfigError("--config: there is no setting '" + item.fullname() +
                           "'; the keys are the flags of --help without '--', and limits stand in "
                           "the table [limits]");
}

std::vector<CLI::ConfigItem> ConfigFile::from_config(std::istream& input) const {
  std::vector<CLI::ConfigItem> settings;
  std::set<std::string> seen;
  for (CLI::ConfigItem& item : CLI::ConfigTOML::from_config(input)) {
    if (is_mark(item)) continue;
    const bool is_limit = item.parents == std::vector<std::string>{kLimits};
    // CLI11 merges a key repeated on consecutive lines into a list.
    if (!seen.insert(item.fullname()).second || (is_limit && item.inputs.size() != 1))
      throw CLI::ConfigError("--config: '" + item.fullname() + "' is set twice");
    if (is_limit) {
      limits_.push_back(item.name + "=" + item.inputs.front());
      continue;
    }
    check(item);
    settings.push_back(std::move(item));
  }
  return settings;
}

}  // namespace heliograph::server
