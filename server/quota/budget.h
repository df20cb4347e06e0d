// Quotas: amounts in use (Budget, Charge) and amounts per second (Rate).
#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "renderer/base/error.h"
#include "server/quota/overload.h"

namespace heliograph::server {

/// Amount of a resource in use, and its limit: of one tenant, or the total that tenants share.
/// Within a total each tenant has a share that others cannot take, so that no tenant ever has all.
/// Thread: any; one mutex for a total and its parts, held for less than a microsecond per tenant.
class Budget {
 public:
  /// Words of a refusal: the unit counted, how the user makes room, the limit's name.
  struct RefusalText {
    std::string unit;
    std::string remedy;
    std::string limit;
  };
  /// total   charged along with this budget; null: none
  Budget(u64 limit, RefusalText text, std::shared_ptr<Budget> total = nullptr);
  Budget(const Budget&) = delete;
  Budget& operator=(const Budget&) = delete;
  ~Budget();

  /// Takes an amount. RESOURCE_EXHAUSTED with the amounts needed and available; takes nothing then.
  [[nodiscard]] Status take(u64 amount);
  /// Takes an amount that exists already, even beyond the limit.
  void count(u64 amount);
  void give_back(u64 amount);
  [[nodiscard]] u64 used() const { return used_; }
  [[nodiscard]] u64 limit() const { return limit_; }
  /// Sets the limit; the amount in use stays, even beyond it.
  void set_limit(u64 limit) { limit_ = limit; }
  [[nodiscard]] const std::string& name() const { return text_.limit; }

  // Totals only, before they are used:
  /// Sets each tenant's share to 1 / parts, or less where there are more tenants than parts.
  void set_parts(u64 parts) { parts_ = parts; }
  /// Sets the policy that admit() follows while the total is nearly full.
  void set_overload(std::shared_ptr<const Overload> overload) { overload_ = std::move(overload); }

  /// Admits new work of a tenant that will bring `bytes` into memory. RESOURCE_EXHAUSTED with a
  /// retry time when the total is too full for this kind of work and the tenant exceeds its share,
  /// or when the process's memory is.
  [[nodiscard]] Status admit(Work work, u64 bytes = 0) const;
  /// Checks the process's memory alone, for work that goes on.
  [[nodiscard]] Status check_memory(Work work, u64 bytes = 0) const;

 private:
  // All under the mutex.
  [[nodiscard]] u64 share() const;                          // of a total: each tenant's
  [[nodiscard]] u64 available(const Budget& tenant) const;  // of a total: to this tenant
  [[nodiscard]] std::unexpected<Error> refuse(u64 amount, u64 available) const;
  [[nodiscard]] std::mutex& mutex() const { return total_ ? total_->mutex_ : mutex_; }

  std::atomic<u64> limit_;
  const RefusalText text_;
  const std::shared_ptr<Budget> total_;
  std::atomic<u64> used_ = 0;
  mutable std::mutex mutex_;
  // Totals only:
  u64 parts_ = 8;
  std::shared_ptr<const Overload> overload_;
  std::vector<const Budget*> tenants_;  // tenants that share this total
};

/// An amount taken from a budget, given back by the destructor.
class Charge {
 public:
  [[nodiscard]] static Expected<Charge> take(std::shared_ptr<Budget> budget, u64 amount);
  [[nodiscard]] static Charge count(std::shared_ptr<Budget> budget, u64 amount);
  /// Returns a charge of 0, which can grow.
  [[nodiscard]] static Charge none(std::shared_ptr<Budget> budget) {
    return count(std::move(budget), 0);
  }
  /// As take(), for an amount that several objects share.
  [[nodiscard]] static Expected<std::shared_ptr<const void>> hold(std::shared_ptr<Budget> budget,
                                                                  u64 amount);
  Charge() = default;
  Charge(Charge&& other) noexcept = default;
  Charge& operator=(Charge&& other) noexcept;
  ~Charge();

  /// Changes the amount; unchanged on failure. A charge without a budget counts nothing.
  [[nodiscard]] Status resize(u64 amount);
  /// Adds another charge of the same budget.
  void merge(Charge other);
  /// Splits off an amount, at most all of it, as a charge of its own.
  [[nodiscard]] Charge split(u64 amount);
  [[nodiscard]] u64 amount() const { return amount_; }
  /// As Budget::check_memory().
  [[nodiscard]] Status check_memory(Work work) const {
    return budget_ ? budget_->check_memory(work) : Status();
  }

 private:
  std::shared_ptr<Budget> budget_;
  u64 amount_ = 0;
};

/// Token bucket: a rate per second, with some seconds of burst and debt. Work is admitted while the
/// bucket is not empty, and charged once its cost is known. Thread: any.
class Rate {
 public:
  using Clock = std::chrono::steady_clock;

  Rate(u64 per_second, std::string name) : per_second_(per_second), name_(std::move(name)) {}

  [[nodiscard]] u64 limit() const { return per_second_; }
  /// Sets the rate; the time to refill the bucket stays.
  void set_limit(u64 per_second) { per_second_ = per_second; }
  [[nodiscard]] const std::string& name() const { return name_; }

  /// Admits work. RESOURCE_EXHAUSTED with the time until the debt is paid.
  [[nodiscard]] Status admit(Clock::time_point now = Clock::now());
  void charge(u64 amount, Clock::time_point now = Clock::now());

 private:
  void refill(Clock::time_point now);  // under mutex_

  std::atomic<u64> per_second_;
  const std::string name_;
  std::mutex mutex_;
  double missing_ = 0;  // seconds until the bucket is full
  Clock::time_point filled_ = Clock::now();
};

}  // namespace heliograph::server
