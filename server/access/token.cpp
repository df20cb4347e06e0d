// Making and reading the TCP token. Called by identity.cpp.
#include "server/access/token.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>

#include <array>
#include <cerrno>
#include <cstring>

#include "server/os/unique_fd.h"

namespace heliograph::server {
namespace {

Expected<std::string> make_token(int fd, const std::string& path) {
  std::array<unsigned char, 32> random;
  if (::getrandom(random.data(), random.size(), 0) != ssize_t(random.size()))
    return fail(Code::kInternal, "--token-file", "no random numbers");
  std::string token;
  for (const unsigned char byte : random) token += fmt::format("{:02x}", byte);
  if (::write(fd, token.data(), token.size()) != ssize_t(token.size()))
    return fail(Code::kUnavailable, "--token-file",
                "cannot write " + path + ": " + std::strerror(errno));
  return token;
}

}  // namespace

Expected<std::string> load_token(const std::string& path) {
  const int made = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (made >= 0) return make_token(UniqueFd(made).get(), path);
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
  struct stat info{};
  if (!fd || ::fstat(fd.get(), &info) != 0)
    return fail(Code::kUnavailable, "--token-file",
                "cannot read " + path + ": " + std::strerror(errno));
  if ((info.st_mode & 0077) != 0 || info.st_uid != ::geteuid())
    return fail(Code::kPermissionDenied, "--token-file",
                path + " must be yours alone; run `chmod 600` on it");
  std::string token(4096, '\0');
  const ssize_t size = ::read(fd.get(), token.data(), token.size());
  token.resize(size > 0 ? std::size_t(size) : 0);
  while (!token.empty() && std::isspace(static_cast<unsigned char>(token.back()))) token.pop_back();
  if (token.size() < 16)
    return fail(Code::kInvalidArgument, "--token-file",
                path + " holds fewer than 16 characters; delete it to have one made");
  return token;
}

}  // namespace heliograph::server
