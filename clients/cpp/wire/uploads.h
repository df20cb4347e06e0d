// Uploads of one session: arrays above 1 MiB by hash or anonymously, files by hash. Thread: any.
#pragma once

#include <string>
#include <string_view>

#include "heliograph/array.h"
#include "heliograph/v1/service.pb.h"

namespace heliograph::client::wire {

class Session;

/// 12 hexadecimal digits of the SHA-256.
std::string short_hash(std::string_view bytes);

class Uploads {
 public:
  explicit Uploads(Session& session) : session_(session) {}

  /// An array that stays as it is (topology, texels): the same bytes travel once.
  void put_asset(const Array& array, v1::Array* out);
  /// An array that changes often (vertices, matrices): not hashed, used up by one edit.
  void put_edited(const Array& array, v1::Array* out);
  /// Uploads bytes unless the daemon has them, which it alone knows; their SHA-256.
  std::string blob(std::string_view bytes);

 private:
  void push(std::string_view bytes, v1::UploadBlobRequest first);

  Session& session_;
};

}  // namespace heliograph::client::wire
