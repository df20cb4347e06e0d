// Arrays of one session: its uploads, blobs, shared buffers and decoded assets. Owned by the
// session.
#pragma once

#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "heliograph/v1/service.pb.h"
#include "server/convert/transaction.h"
#include "server/store/assets.h"
#include "server/store/blobs.h"
#include "server/store/shared_uploads.h"

namespace heliograph::server {

/// An anonymous upload or shared buffer that a request consumed.
struct UsedUpload {
  v1::Array array;
  BufferPtr bytes;
};

/// Resolves the arrays of a session's requests to bytes. Keeps blobs and assets that the session
/// brought or named recently (recent.h), referenced or not, and anonymous uploads until a request
/// consumes them.
///
/// Arrays fail with INVALID_ARGUMENT (nothing set, too long inline), NOT_FOUND (no such blob,
/// upload, buffer or asset). Thread: any; one mutex, held for a lookup. The stores outlive it.
class SessionArrays final : public ArraySource {
 public:
  /// budget   bytes of the owner
  SessionArrays(BlobStore& blobs, AssetStore& assets, std::shared_ptr<Budget> budget)
      : blobs_(blobs),
        assets_(assets),
        budget_(std::move(budget)),
        shared_(budget_),
        recent_(blobs.limits().recent) {}
  SessionArrays(BlobStore& blobs, AssetStore& assets)
      : SessionArrays(blobs, assets, blobs.budget()) {}

  /// Begins an upload by its first message. nullopt: the bytes are present already, and are held
  /// from now on.
  [[nodiscard]] Expected<std::optional<Incoming>> begin(const v1::UploadBlobRequest& first);
  /// Ends an upload and keeps its bytes under the name in its first message.
  [[nodiscard]] Status finish(const v1::UploadBlobRequest& first, Incoming incoming);

  /// Keeps bytes that the daemon made, already charged, as a blob; returns its hash.
  [[nodiscard]] std::string hold(BufferPtr bytes);
  [[nodiscard]] std::shared_ptr<const StoredAsset> hold(std::shared_ptr<const StoredAsset> asset);
  /// Returns the asset of this hash and keeps it as if it were new; null when it is not alive.
  [[nodiscard]] std::shared_ptr<const StoredAsset> find_asset(std::string_view hash);

  /// Restores uploads consumed by a request that did not happen, for use by the same arrays.
  void give_back(const std::vector<UsedUpload>& uploads);

  /// Drops what was not named recently. Frees memory, which may take long.
  void sweep();

  /// Returns the buffers that the client handed over.
  [[nodiscard]] SharedUploads& shared() { return shared_; }

  [[nodiscard]] Expected<BufferPtr> bytes(const v1::Array& array) override;
  [[nodiscard]] Expected<bool> read(const v1::Array& array, u64 bytes,
                                    const TakePiece& take) override;
  [[nodiscard]] Expected<BufferPtr> take(const v1::Array& array, u64 bytes, Numbers kind) override;
  [[nodiscard]] Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) override;
  /// Returns the blob of this hash. The caller passes it to used() once it needs it no more.
  [[nodiscard]] Expected<BufferPtr> blob(std::string_view hash);
  void used(const std::string& hash, const BufferPtr& bytes);

 private:
  [[nodiscard]] Expected<BufferPtr> copy(std::string_view bytes) const;
  [[nodiscard]] Expected<Incoming> make_room(const v1::UploadBlobRequest& first) const;
  [[nodiscard]] Expected<BufferPtr> find_blob(const std::string& hash);
  /// Drops everything named to make room; false: there was nothing.
  bool forget_named();
  void keep(const std::shared_ptr<const StoredAsset>& asset);
  void bring(Recent::Kind kind, const std::string& name, BufferPtr bytes);
  /// Takes what give_back() restored for a reference; null: nothing.
  [[nodiscard]] BufferPtr take_returned(const v1::BufferRef& ref);
  [[nodiscard]] Expected<BufferPtr> take_upload(const std::string& request_id);

  BlobStore& blobs_;
  AssetStore& assets_;
  const std::shared_ptr<Budget> budget_;
  SharedUploads shared_;
  const std::shared_ptr<const bool> bringing_ = std::make_shared<bool>();  // held by uploads
  std::mutex mutex_;
  Recent recent_;
};

}  // namespace heliograph::server
