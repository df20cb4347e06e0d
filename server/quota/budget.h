// Limits that are shared: how much may be in use, and how much a second.
#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <string>

#include "renderer/base/error.h"

namespace heliograph::server {

/// What may be in use, and how much is. Thread: any.
class Budget {
 public:
  /// How its refusals are worded: what it counts, how the user makes room, the limit's name.
  struct Words {
    std::string unit;
    std::string remedy;
    std::string limit;
  };
  /// What is taken is taken from `parent` too, if there is one.
  Budget(u64 limit, Words words, std::shared_ptr<Budget> parent = nullptr)
      : limit_(limit), words_(std::move(words)), parent_(std::move(parent)) {}

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

 private:
  std::atomic<u64> limit_;
  const Words words_;
  const std::shared_ptr<Budget> parent_;
  std::atomic<u64> used_ = 0;
};

/// A share of a budget, given back with its end.
class Charge {
 public:
  [[nodiscard]] static Expected<Charge> take(std::shared_ptr<Budget> budget, u64 amount);
  [[nodiscard]] static Charge count(std::shared_ptr<Budget> budget, u64 amount);
  /// The same for what several things own together.
  [[nodiscard]] static Expected<std::shared_ptr<const void>> hold(std::shared_ptr<Budget> budget,
                                                                  u64 amount);
  Charge() = default;
  Charge(Charge&& other) noexcept = default;
  Charge& operator=(Charge&& other) noexcept;
  ~Charge();

  /// Takes more, or gives some back. When that fails it stays as it was.
  [[nodiscard]] Status resize(u64 amount);
  /// Takes over one of the same budget.
  void merge(Charge other);
  [[nodiscard]] u64 amount() const { return amount_; }

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
