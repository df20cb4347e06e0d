// The tenants file: what it says, what is refused, and who a caller is then.
#include "server/access/identity.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "server/access/secret_file.h"
#include "server/access/tenant.h"
#include "server/os/hash.h"
#include "server/store/session_arrays.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

const std::string kToken = "a-token-that-is-long-enough";

std::string hex_hash(const std::string& token) {
  std::string text = "sha256:";
  for (const unsigned char byte : sha256(token)) text += fmt::format("{:02x}", byte);
  return text;
}

const std::string kFile =
    "# who may\n"
    "robots  token " +
    hex_hash(kToken) +
    "\n"
    "\n"
    "robots\tcertificate node7.example.org  # the seventh\n"
    "vision certificate spiffe://cluster/vision\r\n"
    "ops socket\n";

/// "" for nobody.
std::string name_of(const Identities& identities, const Caller& caller) {
  const std::string* found = identities.tenant_of(caller);
  return found != nullptr ? *found : "";
}

}  // namespace

TEST_CASE("identities: a token says who, then a certificate, then the socket") {
  const auto file = Identities::parse(kFile);
  REQUIRE(file);
  CHECK(file->tenants() == std::set<std::string>{"ops", "robots", "vision"});
  CHECK(name_of(*file, {.token = kToken}) == "robots");
  CHECK(name_of(*file, {.is_local = true, .token = kToken}) == "robots");
  CHECK(name_of(*file, {.is_local = true}) == "ops");
  CHECK(name_of(*file, {.names = {"x", "node7.example.org"}}) == "robots");
  CHECK(name_of(*file, {.names = {"spiffe://cluster/vision"}}) == "vision");
  CHECK(name_of(*file, {.token = kToken, .names = {"spiffe://cluster/vision"}}) == "robots");
}

TEST_CASE("identities: what is wrong is nobody's, whatever else is right") {
  const auto file = Identities::parse(kFile);
  REQUIRE(file);
  CHECK(name_of(*file, {}).empty());
  CHECK(name_of(*file, {.is_local = true, .token = "another-long-enough-token"}).empty());
  CHECK(name_of(*file, {.token = "x", .names = {"node7.example.org"}}).empty());
  CHECK(name_of(*file, {.names = {"node7.example.org", "spiffe://cluster/vision"}}).empty());
  CHECK(name_of(*file, {.names = {"NODE7.example.org"}}).empty());
  const auto other = Identities::parse("robots token " + hex_hash("short") + "\n");
  REQUIRE(other);
  CHECK(name_of(*other, {.token = "short"}).empty());
  CHECK(name_of(*other, {.is_local = true}).empty());
}

TEST_CASE("identities: a wrong file is refused by its line, without what is in it") {
  const std::string secret = "secret-secret-secret";
  const std::vector<std::string> lines{"robots token " + secret,
                                       "robots token sha256:" + secret,
                                       "robots token sha256:" + std::string(64, 'g'),
                                       "robots " + secret,
                                       "robots certificate",
                                       "robots socket " + secret,
                                       "robots certificate " + secret + " " + secret,
                                       "../robots certificate x",
                                       std::string(65, 'x') + " certificate x",
                                       "vision certificate node7.example.org",
                                       "vision token " + hex_hash(kToken),
                                       "robots socket",
                                       "robots weight",
                                       "robots weight 1 1",
                                       "robots weight " + secret,
                                       "robots weight 2x",
                                       "robots weight 0",
                                       "robots weight -1",
                                       "robots weight nan",
                                       "robots weight 101",
                                       "vision weight 2",
                                       "robots limit tenant_bytes",
                                       "robots limit tenant_bytes " + secret,
                                       "robots limit tenant_bytes 0",
                                       "robots limit tenant_bytes 1 2",
                                       "robots limit " + secret + " 1",
                                       "robots limit jobs 1",
                                       "vision limit tenant_jobs 7"};
  const std::string file = kFile + "vision weight 1\nvision limit tenant_jobs 7\n";
  for (const std::string& line : lines) {
    INFO(line);
    const auto parsed = Identities::parse(file + line + "\n");
    REQUIRE(!parsed);
    CHECK(parsed.error().where == "--tenants");
    CHECK(parsed.error().message.starts_with("line 9: "));
    CHECK(parsed.error().message.find(secret) == std::string::npos);
  }
  CHECK(Identities::parse(kFile + "robots certificate node7.example.org\n"));
  for (const std::string& text : {std::string(), std::string("# nobody\n"), kFile + "ops socket"})
    CHECK(!Identities::parse(text));
}

TEST_CASE("tenants: an identity that is taken away is nobody's at once, its tenant is told") {
  Tenants tenants(Limits{}, *Identities::parse(kFile));
  const auto robots = tenants.of({.token = kToken});
  REQUIRE(robots);
  CHECK((*robots)->name == "robots");
  CHECK((*robots)->id != (*tenants.of({.is_local = true}))->id);
  CHECK(tenants.are_several());

  const auto gone = tenants.replace(*Identities::parse("robots token " + hex_hash(kToken) + "\n"));
  CHECK(gone.size() == 2);
  CHECK(*tenants.of({.token = kToken}) == *robots);
  CHECK(tenants.of({.is_local = true}).error().code == Code::kUnauthenticated);
  CHECK(tenants.replace(*Identities::parse("ops socket\n")).front() == *robots);
  CHECK(tenants.of({.token = kToken}).error().message == tenants.of({}).error().message);
}

TEST_CASE("tenants: lines give a weight and limits, others have the daemon's") {
  Limits limits;
  limits.tenant_jobs = 5;
  Tenants tenants(limits, *Identities::parse(kFile + "robots weight 2.5  # more\n"
                                                     "robots limit tenant_jobs 7\n"
                                                     "robots limit tenant_edits_per_second 9\n"));
  const TenantPtr robots = *tenants.of({.token = kToken}), ops = *tenants.of({.is_local = true});
  CHECK(robots->weight() == 2.5);
  CHECK(robots->origin(3, 1).weight == 2.5);
  CHECK(robots->limits().at("tenant_jobs") == 7);
  CHECK(robots->limits().at("tenant_edits_per_second") == 9);
  CHECK(robots->limits().at("tenant_bytes") == limits.tenant_bytes);
  CHECK(robots->limits().size() == 11);
  CHECK(ops->weight() == 1);
  CHECK(ops->limits().at("tenant_jobs") == 5);
}

TEST_CASE("tenants: a grant that is replaced holds at once, what is used stays used") {
  const std::string more = "robots weight 4\nrobots limit tenant_jobs 150\n";
  const std::string less = "robots limit tenant_jobs 2\n";
  Tenants tenants(Limits{}, *Identities::parse(kFile + more));
  const TenantPtr robots = *tenants.of({.token = kToken});
  REQUIRE(robots->ledger.jobs->take(150));
  CHECK(tenants.replace(*Identities::parse(kFile + less)).empty());
  CHECK(robots->weight() == 1);
  CHECK(robots->used().at("tenant_jobs") == 150);
  CHECK(robots->ledger.jobs->take(1).error().available == 0);
  robots->ledger.jobs->give_back(149);
  CHECK(robots->ledger.jobs->take(1));
  CHECK(!robots->ledger.jobs->take(1));
  CHECK(tenants.replace(*Identities::parse(kFile)).empty());
  CHECK(robots->ledger.jobs->limit() == Limits{}.tenant_jobs);
  // Without an identity it keeps what its other lines say: its durable scenes are there.
  CHECK(tenants.replace(*Identities::parse("ops socket\n" + more)).size() == 2);
  CHECK(robots->ledger.jobs->limit() == 150);
  CHECK(tenants.named("robots") == robots);
}

TEST_CASE("tenants: the same bytes of two tenants are two blobs") {
  Tenants tenants(Limits{}, *Identities::parse(kFile));
  const TenantPtr a = *tenants.of({.token = kToken}), b = *tenants.of({.is_local = true});
  const std::string hash = sha256("the same bytes");
  SessionArrays first(a->blobs, a->assets, a->ledger.bytes),
      second(b->blobs, b->assets, b->ledger.bytes);
  v1::UploadBlobRequest request;
  request.set_sha256(hash);
  request.set_size(14);
  auto incoming = first.begin(request);
  REQUIRE((incoming && *incoming));
  REQUIRE((*incoming)->append("the same bytes"));
  REQUIRE(first.finish(request, std::move(**incoming)));
  CHECK(first.blob(hash));
  CHECK(second.blob(hash).error().code == Code::kNotFound);
  CHECK(second.begin(request)->has_value());
}

TEST_CASE("secret files: only those that few may read") {
  namespace fs = std::filesystem;
  const fs::path path = fs::temp_directory_path() / ("hg-secret-" + std::to_string(::getpid()));
  std::ofstream(path) << "secret";
  for (const auto& [mode, secret, trusted] :
       {std::tuple(0600, true, true), std::tuple(0400, true, true), std::tuple(0644, false, true),
        std::tuple(0604, false, true), std::tuple(0620, false, false),
        std::tuple(0602, false, false)}) {
    INFO(mode);
    REQUIRE(::chmod(path.c_str(), mode_t(mode)) == 0);
    CHECK(read_secret(path, "--flag").has_value() == secret);
    CHECK(read_trusted(path, "--flag").has_value() == trusted);
    if (!secret) CHECK(read_secret(path, "--flag").error().code == Code::kPermissionDenied);
  }
  fs::remove(path);
  CHECK(read_secret(path, "--flag").error().where == "--flag");
  CHECK(!read_secret("/dev/null", "--flag"));
}
