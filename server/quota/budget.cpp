// Taking, giving back, and refilling. See budget.h.
#include "server/quota/budget.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace heliograph::server {
namespace {

constexpr double kBucketSeconds = 10;  // what a bucket holds

}  // namespace

Status Budget::take(u64 amount) {
  u64 used = used_;
  do {
    const u64 limit = limit_;
    const u64 available = limit - std::min(used, limit);
    if (amount <= available) continue;
    Error error{.code = Code::kResourceExhausted,
                .message = fmt::format("needs {} {}, {} are available; {}, or raise "
                                       "the limit {}",
                                       amount, words_.unit, available, words_.remedy, words_.limit),
                .where = ""};
    error.limit = words_.limit;
    error.needed = amount;
    error.available = available;
    error.allowed = limit;
    return std::unexpected(std::move(error));
  } while (!used_.compare_exchange_weak(used, used + amount));
  if (!parent_) return {};
  auto status = parent_->take(amount);
  if (!status) used_ -= amount;
  return status;
}

void Budget::count(u64 amount) {
  used_ += amount;
  if (parent_) parent_->count(amount);
}

void Budget::give_back(u64 amount) {
  used_ -= amount;
  if (parent_) parent_->give_back(amount);
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
