// UploadBlob, in chunks.
#include "wire/uploads.h"

#include <openssl/evp.h>

#include <algorithm>

#include "wire/arrays.h"
#include "wire/session.h"

namespace heliograph::client::wire {
namespace {

constexpr std::size_t kChunkBytes = 1 << 20;

std::string sha256_of(std::string_view bytes) {
  std::string digest(32, '\0');
  EVP_Digest(bytes.data(), bytes.size(), reinterpret_cast<unsigned char*>(digest.data()), nullptr,
             EVP_sha256(), nullptr);
  return digest;
}

std::string_view bytes_of(const Array& array) {
  return {reinterpret_cast<const char*>(array.data()), array.bytes()};
}

}  // namespace

std::string short_hash(std::string_view bytes) {
  std::string out;
  for (const char c : sha256_of(bytes).substr(0, 6)) {
    out += "0123456789abcdef"[(c >> 4) & 15];
    out += "0123456789abcdef"[c & 15];
  }
  return out;
}

void Uploads::put_asset(const Array& array, v1::Array* out) {
  if (array.bytes() <= kInlineBytes) return put_inline(array, out);
  describe(array, out);
  out->set_blob(blob(bytes_of(array)));
}

void Uploads::put_edited(const Array& array, v1::Array* out) {
  if (array.bytes() <= kInlineBytes) return put_inline(array, out);
  describe(array, out);
  v1::UploadBlobRequest first;
  first.set_request_id(make_request_id());
  push(bytes_of(array), first);
  out->set_upload(first.request_id());
}

std::string Uploads::blob(std::string_view bytes) {
  std::string digest = sha256_of(bytes);
  v1::UploadBlobRequest first;
  first.set_request_id(make_request_id());
  first.set_sha256(digest);
  push(bytes, std::move(first));
  return digest;
}

void Uploads::push(std::string_view bytes, v1::UploadBlobRequest first) {
  grpc::ClientContext context;
  session_.prepare(context);
  v1::UploadBlobReply reply;
  const auto writer = session_.stub().UploadBlob(&context, &reply);
  v1::UploadBlobRequest request = std::move(first);
  request.set_size(bytes.size());
  std::size_t at = 0;
  do {
    const std::string_view chunk = bytes.substr(at, kChunkBytes);
    request.set_chunk(chunk.data(), chunk.size());
    if (!writer->Write(request)) break;  // the status states why, or that the rest is not needed
    request.Clear();
    at += chunk.size();
  } while (at < bytes.size());
  writer->WritesDone();
  session_.check(writer->Finish());
}

}  // namespace heliograph::client::wire
