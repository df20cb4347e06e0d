// Checks of a ReadRequest, and its answers cut to messages.
#include "server/convert/read.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "server/convert/fields.h"
#include "server/convert/resolve.h"
#include "server/convert/transaction.h"

namespace heliograph::server {
namespace {

constexpr u64 kChunk = 1u << 20;

Status check_fields(const v1::ReadRequest& request) {
  const std::vector<std::string> valid = FieldReader::names();
  if (request.fields().empty())
    return fail(Code::kInvalidArgument, "fields",
                fmt::format("is empty; ask for some of: {}", fmt::join(valid, ", ")));
  for (int i = 0; i < request.fields_size(); ++i) {
    const std::string& field = request.fields(i);
    if (std::ranges::find(valid, field) == valid.end())
      return fail(Code::kInvalidArgument, indexed("fields", u64(i)),
                  fmt::format("'{}' does not exist; these do: {}", field, fmt::join(valid, ", ")));
    if (request.refs().empty() && field != "dome")
      return fail(Code::kInvalidArgument, "refs",
                  fmt::format("is empty; name the objects whose '{}' is asked for", field));
  }
  return {};
}

}  // namespace

Expected<Reading> Reading::create(const v1::ReadRequest& request,
                                  std::shared_ptr<const Snapshot> snapshot) {
  HELIO_TRY(check_known(request));
  HELIO_TRY(check_fields(request));
  Reading reading(request, std::move(snapshot));
  for (int i = 0; i < request.refs_size(); ++i)
    HELIO_TAKE(reading.ids_.emplace_back(), resolve(request.refs(i), *reading.snapshot_),
               indexed("refs", u64(i)));
  if (reading.ids_.empty()) reading.ids_.emplace_back();
  return reading;
}

Status Reading::read_answer() {
  offset_ = 0;
  while (!answer_ && next_ < ids_.size() * fields_.size()) {
    ref_ = u32(next_ / fields_.size());
    field_ = u32(next_ % fields_.size());
    ++next_;
    HELIO_TAKE(answer_, reader_.read(ids_[ref_], fields_[field_]), indexed("fields", field_));
  }
  return {};
}

void Reading::fill(v1::ReadReply& reply) {
  reply.set_revision(snapshot_->revision);
  reply.set_ref(ref_);
  reply.set_field(field_);
  if (answer_->object) {
    *reply.mutable_object() = std::move(*answer_->object);
    answer_.reset();
    return;
  }
  const auto bytes = answer_->bytes->bytes();
  const u64 size = std::min<u64>(kChunk, bytes.size() - offset_);
  reply.set_offset(offset_);
  *reply.mutable_array() = answer_->array;
  reply.mutable_array()->set_inline_(bytes.data() + offset_, size);
  offset_ += size;
  if (offset_ == bytes.size()) answer_.reset();
}

Expected<bool> Reading::next(v1::ReadReply& reply) {
  reply.Clear();
  if (!answer_) HELIO_TRY(read_answer());
  if (!answer_) return false;
  fill(reply);
  return true;
}

}  // namespace heliograph::server
