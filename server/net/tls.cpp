// See tls.h.
#include "server/net/tls.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <grpcpp/security/tls_certificate_provider.h>
#include <grpcpp/security/tls_certificate_verifier.h>
#include <grpcpp/security/tls_credentials_options.h>
#include <openssl/pem.h>
#include <openssl/x509.h>
#include <sys/mman.h>

#include <cerrno>
#include <cstring>

#include "server/access/secret_file.h"

namespace heliograph::server {
namespace {

constexpr unsigned kReadSeconds = 1;  // gRPC's minimum
constexpr const char* kCertFlag = "--tls-cert";
constexpr const char* kKeyFlag = "--tls-key";
constexpr const char* kCaFlag = "--tls-client-ca";

using Bio = std::unique_ptr<BIO, decltype(&BIO_free)>;
using X509Ptr = std::unique_ptr<X509, decltype(&X509_free)>;
using KeyPtr = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;

Bio bio_of(const std::string& pem) {
  return {BIO_new_mem_buf(pem.data(), int(pem.size())), &BIO_free};
}

X509Ptr certificate_of(const std::string& pem) {
  return {PEM_read_bio_X509(bio_of(pem).get(), nullptr, nullptr, nullptr), &X509_free};
}

Status check_pair(const std::string& cert, const std::string& key) {
  const X509Ptr first = certificate_of(cert);
  if (!first) return fail(Code::kInvalidArgument, kCertFlag, "holds no certificate in PEM");
  std::string no_password;  // makes an encrypted key fail instead of prompting
  const KeyPtr own(PEM_read_bio_PrivateKey(bio_of(key).get(), nullptr, nullptr, no_password.data()),
                   &EVP_PKEY_free);
  if (!own)
    return fail(Code::kInvalidArgument, kKeyFlag, "holds no private key in PEM without a password");
  if (X509_check_private_key(first.get(), own.get()) != 1)
    return fail(Code::kInvalidArgument, kKeyFlag, "is not the key of --tls-cert's certificate");
  return {};
}

std::string path_of(const UniqueFd& fd) { return fmt::format("/proc/self/fd/{}", fd.get()); }

/// Replaces the text that the path of `slot` names, atomically.
Status put(UniqueFd& slot, const std::string& text) {
  UniqueFd made(::memfd_create("tls", MFD_CLOEXEC));
  if (!made || ::write(made.get(), text.data(), text.size()) != ssize_t(text.size()))
    return fail(Code::kUnavailable, kCertFlag,
                fmt::format("cannot be copied to memory: {}", std::strerror(errno)));
  if (!slot)
    slot = std::move(made);
  else
    ::dup3(made.get(), slot.get(), O_CLOEXEC);
  return {};
}

/// Accepts clients whose certificate names a tenant.
class TenantVerifier final : public grpc::experimental::ExternalCertificateVerifier {
 public:
  explicit TenantVerifier(const Tenants& tenants) : tenants_(tenants) {}

  bool Verify(grpc::experimental::TlsCustomVerificationCheckRequest* request,
              std::function<void(grpc::Status)> /*later*/, grpc::Status* now) override {
    Caller caller;
    const auto add = [&](const std::vector<grpc::string_ref>& names) {
      for (const grpc::string_ref& name : names)
        caller.names.emplace_back(name.data(), name.size());
    };
    add(request->dns_names());
    add(request->uri_names());
    add(request->email_names());
    add(request->ip_names());
    if (caller.names.empty()) add({request->common_name()});
    if (!tenants_.of(caller))
      *now = grpc::Status(grpc::UNAUTHENTICATED, "the certificate names no tenant");
    return true;
  }
  void Cancel(grpc::experimental::TlsCustomVerificationCheckRequest* /*request*/) override {}

 private:
  const Tenants& tenants_;
};

}  // namespace

Expected<std::unique_ptr<Tls>> Tls::load(const Config& config) {
  std::unique_ptr<Tls> tls(new Tls(config));
  HELIO_TRY(tls->reload());
  return tls;
}

Status Tls::reload() {
  const auto cert = read_trusted(config_.tls_cert, kCertFlag);
  if (!cert) return std::unexpected(cert.error());
  const auto key = read_secret(config_.tls_key, kKeyFlag);
  if (!key) return std::unexpected(key.error());
  HELIO_TRY(check_pair(*cert, *key));
  if (!config_.tls_client_ca.empty()) {
    const auto ca = read_trusted(config_.tls_client_ca, kCaFlag);
    if (!ca) return std::unexpected(ca.error());
    if (!certificate_of(*ca))
      return fail(Code::kInvalidArgument, kCaFlag, "holds no certificate in PEM");
    HELIO_TRY(put(client_ca_, *ca));
  }
  HELIO_TRY(put(key_, *key));
  return put(cert_, *cert);
}

std::shared_ptr<grpc::ServerCredentials> Tls::credentials(const Tenants& tenants) const {
  using grpc::experimental::ExternalCertificateVerifier;
  using grpc::experimental::FileWatcherCertificateProvider;
  const bool is_mutual = bool(client_ca_);
  grpc::experimental::TlsServerCredentialsOptions options(
      std::make_shared<FileWatcherCertificateProvider>(
          path_of(key_), path_of(cert_), is_mutual ? path_of(client_ca_) : "", kReadSeconds));
  options.watch_identity_key_cert_pairs();
  if (is_mutual) {
    options.watch_root_certs();
    options.set_cert_request_type(GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY);
    options.set_certificate_verifier(ExternalCertificateVerifier::Create<TenantVerifier>(tenants));
  }
  options.set_check_call_host(false);
  return grpc::experimental::TlsServerCredentials(options);
}

}  // namespace heliograph::server
