// Limits that are shared: how much may be in use, and how much a second.
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

/// What may be in use, and how much is: of one tenant, or the total that tenants share. Of a total
/// each tenant has a part that others cannot take, its share, so that none ever has all.
/// Thread: any; one mutex for a total and its parts, held for less than a microsecond per tenant.
class Budget {
 public:
  /// How its refusals are worded: what it counts, how the user makes room, the limit's name.
  struct Words {
    std::string unit;
    std::string remedy;
    std::string limit;
  };
  /// What is taken is taken from `total` too, if there is one.
  Budget(u64 limit, Words words, std::shared_ptr<Budget> total = nullptr);
  Budget(const Budget&) = delete;
  Budget& operator=(const Budget&) = delete;
  ~Budget();

  /// RESOURCE_EXHAUSTED with what is needed and what there is; nothing is taken then.
  [[nodiscard]] Status take(u64 amount);
  /// Counts what is there already, whatever the limit is.
  void count(u64 amount);
  void give_back(u64 amount);
  [[nodiscard]] u64 used() const { return used_; }
  [[nodiscard]] u64 limit() const { return limit_; }
  /// What is used stays used, more than the limit too.
  void set_limit(u64 limit) { limit_ = limit; }
  [[nodiscard]] const std::string& name() const { return words_.limit; }

  // Of a total, before it is used:
  /// 1 / parts is each tenant's share, or less where there are more tenants than parts.
  void set_parts(u64 parts) { parts_ = parts; }
  /// Refuses work while it is full.
  void set_overload(std::shared_ptr<const Overload> overload) { overload_ = std::move(overload); }

  /// Of a tenant's: RESOURCE_EXHAUSTED with a retry time when the total is too full for this work
  /// and the tenant has more than its share, or when the daemon's memory is, which this work brings
  /// so many bytes into.
  [[nodiscard]] Status admit(Work work, u64 bytes = 0) const;
  /// The same for work that goes on: the daemon's memory alone.
  [[nodiscard]] Status check_memory(Work work, u64 bytes = 0) const;

 private:
  // All under the mutex.
  [[nodiscard]] u64 share() const;                          // of a total: each tenant's
  [[nodiscard]] u64 available(const Budget& tenant) const;  // of a total: to this tenant
  [[nodiscard]] std::unexpected<Error> refuse(u64 amount, u64 available) const;
  [[nodiscard]] std::mutex& mutex() const { return total_ ? total_->mutex_ : mutex_; }

  std::atomic<u64> limit_;
  const Words words_;
  const std::shared_ptr<Budget> total_;
  std::atomic<u64> used_ = 0;
  mutable std::mutex mutex_;
  // Of a total:
  u64 parts_ = 8;
  std::shared_ptr<const Overload> overload_;
  std::vector<const Budget*> tenants_;  // that share it
};

/// A share of a budget, given back with its end.
class Charge {
 public:
  [[nodiscard]] static Expected<Charge> take(std::shared_ptr<Budget> budget, u64 amount);
  [[nodiscard]] static Charge count(std::shared_ptr<Budget> budget, u64 amount);
  /// Of nothing so far.
  [[nodiscard]] static Charge none(std::shared_ptr<Budget> budget) {
    return count(std::move(budget), 0);
  }
  /// As take(), for what several things own together.
  [[nodiscard]] static Expected<std::shared_ptr<const void>> hold(std::shared_ptr<Budget> budget,
                                                                  u64 amount);
  Charge() = default;
  Charge(Charge&& other) noexcept = default;
  Charge& operator=(Charge&& other) noexcept;
  ~Charge();

  /// Takes more, or gives some back. When that fails it stays as it was. One of no budget counts
  /// nothing.
  [[nodiscard]] Status resize(u64 amount);
  /// Takes over one of the same budget.
  void merge(Charge other);
  /// So much of it, or all of it where it is less, as a charge of its own.
  [[nodiscard]] Charge split(u64 amount);
  [[nodiscard]] u64 amount() const { return amount_; }
  /// Budget::check_memory().
  [[nodiscard]] Status check_memory(Work work) const {
    return budget_ ? budget_->check_memory(work) : Status();
  }

 private:
  std::shared_ptr<Budget> budget_;
  u64 amount_ = 0;
};

/// How much a second, on average: a bucket that holds some seconds' worth and may go into debt.
/// Work is let in while the bucket is not empty, and charged when it is known what it took.
/// Thread: any.
class Rate {
 public:
  using Clock = std::chrono::steady_clock;

  Rate(u64 per_second, std::string name) : per_second_(per_second), name_(std::move(name)) {}

  [[nodiscard]] u64 limit() const { return per_second_; }
  /// Takes as long to fill the bucket as before.
  void set_limit(u64 per_second) { per_second_ = per_second; }
  [[nodiscard]] const std::string& name() const { return name_; }

  /// RESOURCE_EXHAUSTED with the time until the debt is paid.
  [[nodiscard]] Status admit(Clock::time_point now = Clock::now());
  void charge(u64 amount, Clock::time_point now = Clock::now());

 private:
  void refill(Clock::time_point now);  // under mutex_

  std::atomic<u64> per_second_;
  const std::string name_;
  std::mutex mutex_;
  double missing_ = 0;  // seconds' worth, from the full bucket
  Clock::time_point filled_ = Clock::now();
};

}  // namespace heliograph::server
