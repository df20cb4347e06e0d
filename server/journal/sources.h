// Sources of arrays and assets of durable edits: recording into the journal, and recovery from it.
// Used by service_edit.cpp and recovery.cpp.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "server/access/tenant.h"
#include "server/convert/transaction.h"
#include "server/journal/blob_files.h"
#include "server/journal/record.pb.h"
#include "server/store/session_arrays.h"

namespace heliograph::server {

/// Passes on arrays of `inner`, and stores all but inline ones as files. Thread: one at a time.
class RecordingSource final : public ArraySource {
 public:
  RecordingSource(ArraySource& inner, BlobFiles& files) : inner_(inner), files_(files) {}

  [[nodiscard]] Expected<BufferPtr> bytes(const v1::Array& array) override;
  [[nodiscard]] Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) override;

  /// Returns an error when something could not be stored: the transaction read through this must
  /// not be used then.
  [[nodiscard]] const Status& status() const { return status_; }
  /// Fills in the record's transaction, with uploads and buffers named by their hashes. A large one
  /// is stored as a file, which the record names, and returned; "": the record holds it.
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

/// Reads arrays from files, charged to the owner's budget like uploads, regardless of its limits
/// and the daemon's. Caches only the last models: other bytes live as long as what was made of
/// them. Thread: one.
class RecoveringSource final : public ArraySource {
 public:
  RecoveringSource(Tenant& owner, BlobFiles& files) : owner_(owner), files_(files) {}

  /// Sets the assets of the transaction that is read next.
  void expect(const journal::Record& record);
  [[nodiscard]] Expected<BufferPtr> bytes(const v1::Array& array) override;
  [[nodiscard]] Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) override;
  /// Returns the bytes of a file that is no array.
  [[nodiscard]] Expected<std::string> content(const std::string& hash);
  /// Returns the files requested since the last call.
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
