// Parsing and looking up identities. See identity.h.
#include "server/access/identity.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "server/access/secret_file.h"
#include "server/access/token.h"
#include "server/os/hash.h"

namespace heliograph::server {
namespace {

constexpr const char* kFlag = "--tenants";
constexpr std::string_view kHash = "sha256:";
constexpr std::size_t kNameBytes = 64;
constexpr std::size_t kTokenBytes = 16;  // shorter ones can be guessed
constexpr std::string_view kTenantLimit = "tenant_";
constexpr double kLightest = 0.01, kHeaviest = 100;  // weights
constexpr const char* kOnlyTenant = "local";

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  line = line.substr(0, line.find('#'));
  while (true) {
    const auto begin = line.find_first_not_of(" \t\r");
    if (begin == std::string_view::npos) return words;
    line.remove_prefix(begin);
    words.push_back(line.substr(0, line.find_first_of(" \t\r")));
    line.remove_prefix(words.back().size());
  }
}

bool is_name(std::string_view name) {
  const auto is_good = [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '-' || c == '_' || c == '.';
  };
  return name.size() <= kNameBytes && name.front() != '.' && std::ranges::all_of(name, is_good);
}

/// Decodes "sha256:" and 64 hexadecimal digits into 32 bytes; "" for anything else.
std::string hash_of(std::string_view word) {
  if (!word.starts_with(kHash) || word.size() != kHash.size() + 64) return "";
  word.remove_prefix(kHash.size());
  std::string hash;
  for (std::size_t i = 0; i < word.size(); i += 2) {
    unsigned byte = 0;
    const auto parsed = std::from_chars(word.data() + i, word.data() + i + 2, byte, 16);
    if (parsed.ptr != word.data() + i + 2) return "";
    hash += char(byte);
  }
  return hash;
}

std::unexpected<Error> refuse(std::string message) {
  return fail(Code::kInvalidArgument, kFlag, std::move(message));
}

/// Adds an entry; adding the same one twice is no error.
Status put(auto& map, const std::string& key, const std::string& tenant) {
  const auto [entry, is_new] = map.emplace(key, tenant);
  if (is_new || entry->second == tenant) return {};
  return fail(Code::kAlreadyExists, kFlag,
              fmt::format("{} and {} have the same one; give each its own", entry->second, tenant));
}

}  // namespace

Status Identities::add_token(const std::string& hash, const std::string& tenant) {
  return put(tokens_, hash, tenant);
}

Status Identities::add_certificate(const std::string& name, const std::string& tenant) {
  return put(certificates_, name, tenant);
}

Status Identities::set_socket(const std::string& tenant) {
  if (!socket_.empty() && socket_ != tenant)
    return fail(Code::kAlreadyExists, kFlag, "the socket is another tenant's already");
  socket_ = tenant;
  return {};
}

Status Identities::set_weight(std::string_view number, const std::string& tenant) {
  double weight = 0;
  const char* end = number.data() + number.size();
  const auto parsed = std::from_chars(number.data(), end, weight);
  if (parsed.ec != std::errc() || parsed.ptr != end ||
      !(weight >= kLightest && weight <= kHeaviest))
    return refuse(fmt::format("a weight is a number from {} to {}", kLightest, kHeaviest));
  if (lines_[tenant].weight)
    return fail(Code::kAlreadyExists, kFlag, "the tenant has a weight already; leave one");
  lines_[tenant].weight = weight;
  return {};
}

Status Identities::set_limit(std::string_view name, std::string_view number,
                             const std::string& tenant) {
  const auto setting = parse_limit(name, number);
  if (!setting || !name.starts_with(kTenantLimit))
    return refuse(
        "a tenant's limit is one of those of heliographd --help that begin with tenant_, and a "
        "number above 0");
  auto& limits = lines_[tenant].limits;
  if (std::ranges::find(limits, setting->limit, &LimitSetting::limit) != limits.end())
    return fail(Code::kAlreadyExists, kFlag, "the tenant has this limit already; leave one");
  limits.push_back(*setting);
  return {};
}

Status Identities::add_line(std::string_view line) {
  const auto words = words_of(line);
  if (words.empty()) return {};
  const std::string tenant(words[0]);
  if (!is_name(tenant))
    return refuse("a tenant's name has at most 64 letters, digits, '-', '_' and '.'");
  const std::string_view kind = words.size() > 1 ? words[1] : "";
  if (kind == "socket" && words.size() == 2) return set_socket(tenant);
  if (kind == "certificate" && words.size() == 3)
    return add_certificate(std::string(words[2]), tenant);
  if (kind == "weight" && words.size() == 3) return set_weight(words[2], tenant);
  if (kind == "limit" && words.size() == 4) return set_limit(words[2], words[3], tenant);
  if (kind != "token" || words.size() != 3)
    return refuse(
        "write TENANT token sha256:HEX, TENANT certificate NAME, TENANT socket, TENANT weight "
        "NUMBER, or TENANT limit NAME NUMBER");
  const std::string hash = hash_of(words[2]);
  if (hash.empty())
    return refuse(
        "a token is written as sha256: and the 64 digits that `printf %s TOKEN | sha256sum` "
        "prints");
  return add_token(hash, tenant);
}

Expected<Identities> Identities::parse(std::string_view text) {
  if (text.empty() || text.back() != '\n')
    return refuse("is empty or ends in the middle of a line; end it with a newline");
  Identities identities;
  for (std::size_t line = 1; !text.empty(); ++line) {
    const auto end = text.find('\n');
    if (auto added = identities.add_line(text.substr(0, end)); !added) {
      added.error().message = fmt::format("line {}: {}", line, added.error().message);
      return std::unexpected(std::move(added).error());
    }
    text.remove_prefix(end + 1);
  }
  if (identities.tenants().empty()) return refuse("names no tenant; see docs/operations.md");
  return identities;
}

const std::string* Identities::tenant_of(const Caller& caller) const {
  if (!caller.token.empty()) {
    if (caller.token.size() < kTokenBytes) return nullptr;
    const auto found = tokens_.find(sha256(caller.token));
    return found == tokens_.end() ? nullptr : &found->second;
  }
  if (caller.is_local) return socket_.empty() ? nullptr : &socket_;
  const std::string* tenant = nullptr;
  for (const std::string_view name : caller.names) {
    const auto found = certificates_.find(name);
    if (found == certificates_.end()) continue;
    if (tenant != nullptr && *tenant != found->second) return nullptr;
    tenant = &found->second;
  }
  return tenant;
}

std::set<std::string> Identities::tenants() const {
  std::set<std::string> all;
  for (const auto& [hash, tenant] : tokens_) all.insert(tenant);
  for (const auto& [name, tenant] : certificates_) all.insert(tenant);
  if (!socket_.empty()) all.insert(socket_);
  return all;
}

Grant Identities::grant_of(const std::string& tenant, const Limits& limits) const {
  Grant grant{.limits = limits};
  const auto found = lines_.find(tenant);
  if (found == lines_.end()) return grant;
  grant.weight = found->second.weight.value_or(grant.weight);
  for (const auto& [limit, value] : found->second.limits) grant.limits.*limit = value;
  return grant;
}

Expected<Identities> load_identities(const Config& config) {
  if (!config.tenants_file.empty()) {
    const auto text = read_secret(config.tenants_file, kFlag);
    if (!text) return std::unexpected(text.error());
    return Identities::parse(*text);
  }
  Identities identities;
  HELIO_TRY(identities.set_socket(kOnlyTenant));
  if (config.listen.empty()) return identities;
  const auto token = load_token(config.token_file);
  if (!token) return std::unexpected(token.error());
  HELIO_TRY(identities.add_token(sha256(*token), kOnlyTenant));
  return identities;
}

}  // namespace heliograph::server
