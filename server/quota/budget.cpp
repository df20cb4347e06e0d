// Taking, giving back, and refilling. See budget.h.
#include "server/quota/budget.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace heliograph::server {
namespace {

constexpr double kBucketSeconds = 10;  // size of a bucket

}  // namespace

Budget::Budget(u64 limit, RefusalText text, std::shared_ptr<Budget> total)
    : limit_(limit), text_(std::move(text)), total_(std::move(total)) {
  if (!total_) return;
  const std::lock_guard lock(mutex());
  total_->tenants_.push_back(this);
}

Budget::~Budget() {
  if (!total_) return;
  const std::lock_guard lock(mutex());
  std::erase(total_->tenants_, this);
}

u64 Budget::share() const {
  const u64 limit = limit_;
  return limit / std::max<u64>({std::min(parts_, limit), tenants_.size(), 1});
}

u64 Budget::available(const Budget& tenant) const {
  const u64 each = share();
  u64 kept = 0;  // reserved for other tenants
  for (const Budget* other : tenants_)
    if (other != &tenant) kept += each - std::min<u64>(each, other->used_);
  return limit_ - std::min<u64>(limit_, used_ + kept);
}

std::unexpected<Error> Budget::refuse(u64 amount, u64 available) const {
  Error error{.code = Code::kResourceExhausted,
              .message = fmt::format("needs {} {}, {} are available ({} of {} are in use); {}, or "
                                     "raise the limit {}",
                                     amount, text_.unit, available, used_.load(), limit_.load(),
                                     text_.remedy, text_.limit),
              .where = ""};
  error.limit = text_.limit;
  error.needed = amount;
  error.available = available;
  error.allowed = limit_;
  return std::unexpected(std::move(error));
}

Status Budget::take(u64 amount) {
  const std::lock_guard lock(mutex());
  const u64 own = limit_ - std::min<u64>(used_, limit_);
  if (amount > own) return refuse(amount, own);
  if (total_) {
    if (const u64 left = total_->available(*this); amount > left)
      return total_->refuse(amount, left);
    total_->used_ += amount;
  }
  used_ += amount;
  return {};
}

void Budget::count(u64 amount) {
  const std::lock_guard lock(mutex());
  used_ += amount;
  if (total_) total_->used_ += amount;
}

void Budget::give_back(u64 amount) {
  const std::lock_guard lock(mutex());
  used_ -= amount;
  if (total_) total_->used_ -= amount;
}

Status Budget::check_memory(Work work, u64 bytes) const {
  if (!total_ || !total_->overload_) return {};
  return total_->overload_->check_memory(work, bytes);
}

Status Budget::admit(Work work, u64 bytes) const {
  HELIO_TRY(check_memory(work, bytes));
  if (!total_ || !total_->overload_) return {};
  const std::lock_guard lock(mutex());
  const u64 limit = total_->limit_, used = total_->used_;
  if (!total_->overload_->is_full(work, used, limit) || used_ <= total_->share()) return {};
  const u64 allowed = total_->overload_->allowed(work, limit);
  Error error{.code = Code::kResourceExhausted,
              .message = fmt::format("the daemon is too full for {}: {} of {} {} are in use, {} by "
                                     "this tenant, and {} is where they end; {}, retry in {} s, or "
                                     "raise the limit {}",
                                     name_of(work), used, limit, text_.unit, used_.load(), allowed,
                                     text_.remedy, kFullSeconds, total_->text_.limit),
              .where = ""};
  error.limit = total_->text_.limit;
  error.needed = 1;
  error.allowed = allowed;
  error.retry_seconds = kFullSeconds;
  return std::unexpected(std::move(error));
}

Expected<Charge> Charge::take(std::shared_ptr<Budget> budget, u64 amount) {
  HELIO_TRY(budget->take(amount));
  Charge charge;
  charge.budget_ = std::move(budget);
  charge.amount_ = amount;
  return charge;
}

Charge Charge::count(std::shared_ptr<Budget> budget, u64 amount) {
  budget->count(amount);
  Charge charge;
  charge.budget_ = std::move(budget);
  charge.amount_ = amount;
  return charge;
}

Expected<std::shared_ptr<const void>> Charge::hold(std::shared_ptr<Budget> budget, u64 amount) {
  auto charge = take(std::move(budget), amount);
  if (!charge) return std::unexpected(std::move(charge).error());
  return std::make_shared<const Charge>(std::move(*charge));
}

Charge& Charge::operator=(Charge&& other) noexcept {
  std::swap(budget_, other.budget_);
  std::swap(amount_, other.amount_);
  return *this;
}

Charge::~Charge() {
  if (budget_) budget_->give_back(amount_);
}

Status Charge::resize(u64 amount) {
  if (!budget_) return {};
  if (amount > amount_)
    HELIO_TRY(budget_->take(amount - amount_));
  else
    budget_->give_back(amount_ - amount);
  amount_ = amount;
  return {};
}

void Charge::merge(Charge other) {
  if (!budget_) return std::swap(*this, other);
  amount_ += std::exchange(other.amount_, 0);
}

Charge Charge::split(u64 amount) {
  Charge part;
  part.budget_ = budget_;
  part.amount_ = std::min(amount, amount_);
  amount_ -= part.amount_;
  return part;
}

void Rate::refill(Clock::time_point now) {
  const double seconds = std::chrono::duration<double>(now - filled_).count();
  missing_ = std::max(0.0, missing_ - seconds);
  filled_ = now;
}

Status Rate::admit(Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  refill(now);
  const double debt = missing_ - kBucketSeconds;
  if (debt < 0) return {};
  const u64 limit = per_second_;
  const double seconds = debt + 1 / double(limit);
  Error error{.code = Code::kResourceExhausted,
              .message = fmt::format("more than {} a second; retry in {:.2g} s, or raise the "
                                     "limit {}",
                                     limit, seconds, name_),
              .where = ""};
  error.limit = name_;
  error.needed = u64(debt * double(limit)) + 1;
  error.allowed = limit;
  error.retry_seconds = seconds;
  return std::unexpected(std::move(error));
}

void Rate::charge(u64 amount, Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  refill(now);
  missing_ += double(amount) / double(per_second_);
}

}  // namespace heliograph::server
