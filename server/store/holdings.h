// What one session uploaded and decoded, for a while. Owned by the session; goes with it.
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

/// An anonymous upload or a shared buffer that an array used up.
struct UsedUpload {
  v1::Array array;
  BufferPtr bytes;
};

/// Keeps the blobs and assets that its session brought or named lately (recent.h), whether anything
/// refers to them or not, and its anonymous uploads until they are used; and so says where the
/// bytes of its arrays come from.
///
/// Arrays fail with INVALID_ARGUMENT (nothing set, too long inline), NOT_FOUND (no such blob,
/// upload, buffer or asset).
/// Thread: any; one mutex, held for a look-up. The stores outlive it.
class Holdings final : public ArraySource {
 public:
  /// `budget`: of the owner's bytes.
  Holdings(BlobStore& blobs, AssetStore& assets, std::shared_ptr<Budget> budget)
      : blobs_(blobs),
        assets_(assets),
        budget_(std::move(budget)),
        shared_(budget_),
        recent_(blobs.limits().recent) {}
  Holdings(BlobStore& blobs, AssetStore& assets) : Holdings(blobs, assets, blobs.budget()) {}

  /// Begins an upload by its first message. nullopt: the bytes are here already, and are held from
  /// now on.
  [[nodiscard]] Expected<std::optional<Incoming>> begin(const v1::UploadBlobRequest& first);
  /// Ends it, under the name its first message gave.
  [[nodiscard]] Status finish(const v1::UploadBlobRequest& first, Incoming incoming);

  /// Keeps bytes of the daemon's own, charged already, as a blob; returns its hash.
  [[nodiscard]] std::string hold(BufferPtr bytes);
  [[nodiscard]] std::shared_ptr<const StoredAsset> hold(std::shared_ptr<const StoredAsset> asset);
  /// The asset of this hash, kept as if it were new; null when it is not alive.
  [[nodiscard]] std::shared_ptr<const StoredAsset> find_asset(std::string_view hash);

  /// What used them up did not happen: they may be used again, by the same arrays.
  void give_back(const std::vector<UsedUpload>& uploads);

  /// Lets go what was not named for long. Frees it, which may take its time.
  void sweep();

  /// Buffers that its client handed over.
  [[nodiscard]] SharedUploads& shared() { return shared_; }

  [[nodiscard]] Expected<BufferPtr> bytes(const v1::Array& array) override;
  [[nodiscard]] Expected<bool> read(const v1::Array& array, u64 bytes,
                                    const TakePiece& take) override;
  [[nodiscard]] Expected<BufferPtr> take(const v1::Array& array, u64 bytes, Numbers kind) override;
  [[nodiscard]] Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) override;
  /// The blob of this hash. A call that needs it no more says so to `used`.
  [[nodiscard]] Expected<BufferPtr> blob(std::string_view hash);
  void used(const std::string& hash, const BufferPtr& bytes);

 private:
  [[nodiscard]] Expected<BufferPtr> copy(std::string_view bytes) const;
  [[nodiscard]] Expected<Incoming> make_room(const v1::UploadBlobRequest& first) const;
  [[nodiscard]] Expected<BufferPtr> find_blob(const std::string& hash);
  /// Makes room; false: there was nothing.
  bool forget_named();
  void keep(const std::shared_ptr<const StoredAsset>& asset);
  void bring(Recent::Kind kind, const std::string& name, BufferPtr bytes);
  /// What give_back() has of it; null: nothing.
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
