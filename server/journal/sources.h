// Where arrays and assets of durable edits come from, on their way into the journal and out of it.
// Used by service_edit.cpp and recovery.cpp.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "server/access/tenant.h"
#include "server/convert/transaction.h"
#include "server/journal/blob_files.h"
#include "server/journal/record.pb.h"
#include "server/store/holdings.h"

namespace heliograph::server {

/// Gives what `inner` gives, and stores all of it but inline arrays as files. Thread: one at a
/// time.
class RecordingSource final : public ArraySource {
 public:
  RecordingSource(ArraySource& inner, BlobFiles& files) : inner_(inner), files_(files) {}

  [[nodiscard]] Expected<BufferPtr> bytes(const v1::Array& array) override;
  [[nodiscard]] Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) override;

  /// An error when something could not be stored: what came of the transaction is not to be used.
  [[nodiscard]] const Status& status() const { return status_; }
  /// The transaction as it was read through this, uploads and buffers named by their hashes. A
  /// large one is stored as a file, which the record names, and returned; "": the record holds it.
  [[nodiscard]] std::string fill(const v1::Transaction& transaction, journal::Record& record);
  [[nodiscard]] std::vector<BlobFilePtr> take_files() { return std::move(held_); }

 private:
  [[nodiscard]] Status store(const std::string& hash, std::span<const std::byte> bytes);
  [[nodiscard]] Expected<std::string> store(const Asset& asset);

  ArraySource& inner_;
  BlobFiles& files_;
  Status status_;
  std::map<std::string, std::string> consumed_;  // upload or buffer -> hash
  std::map<std::string, std::string> assets_;    // hash -> file
  std::vector<BlobFilePtr> held_;
};

/// Gives what the files hold, counted against the owner's budget like uploads, whatever its limits
/// and the daemon's are now. It keeps none but the last models: bytes live as long as what was made
/// of them. Thread: one.
class RecoveringSource final : public ArraySource {
 public:
  RecoveringSource(Tenant& owner, BlobFiles& files) : owner_(owner), files_(files) {}

  /// The assets of the transaction that is read next.
  void expect(const journal::Record& record);
  [[nodiscard]] Expected<BufferPtr> bytes(const v1::Array& array) override;
  [[nodiscard]] Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) override;
  /// The bytes of a file that is no array.
  [[nodiscard]] Expected<std::string> content(const std::string& hash);
  /// The files that were asked for since the last call.
  [[nodiscard]] std::vector<BlobFilePtr> take_files() { return std::exchange(held_, {}); }

 private:
  [[nodiscard]] Expected<BufferPtr> load(const std::string& hash);

  Tenant& owner_;
  BlobFiles& files_;
  std::map<std::string, std::string, std::less<>> expected_;  // asset -> file
  struct Loaded {
    std::shared_ptr<const Asset> asset;
    std::vector<BlobFilePtr> files;
  };
  std::map<std::string, Loaded, std::less<>> assets_;
  std::vector<BlobFilePtr> held_;
};

}  // namespace heliograph::server
