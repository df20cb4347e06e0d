// A function that the device runs in slices: a coroutine that gives a Status. Used by the runner.
#pragma once

#include <coroutine>
#include <utility>

#include "renderer/base/error.h"

namespace heliograph {

/// Starts when it is awaited, or when somebody resumes handle(); `co_await` gives its result.
/// Exceptions leave through whoever resumed the innermost coroutine; then it may only be destroyed.
/// Owns: the coroutine, and so those that it awaits.
class [[nodiscard]] Steps {
 public:
  // The names that C++20 asks for.
  struct promise_type {  // NOLINT(readability-identifier-naming)
    Status result;
    std::coroutine_handle<> caller = std::noop_coroutine();

    Steps get_return_object() { return Steps(Handle::from_promise(*this)); }
    std::suspend_always initial_suspend() noexcept { return {}; }
    auto final_suspend() noexcept {
      struct ToCaller {
        bool await_ready() noexcept { return false; }
        std::coroutine_handle<> await_suspend(Handle ended) noexcept {
          return ended.promise().caller;
        }
        void await_resume() noexcept {}
      };
      return ToCaller{};
    }
    void return_value(Status status) { result = std::move(status); }
    [[noreturn]] void unhandled_exception() { throw; }
  };
  using Handle = std::coroutine_handle<promise_type>;

  Steps(Steps&& other) noexcept : handle_(std::exchange(other.handle_, {})) {}
  Steps& operator=(Steps&&) = delete;
  ~Steps() {
    if (handle_) handle_.destroy();
  }

  [[nodiscard]] std::coroutine_handle<> handle() const { return handle_; }
  [[nodiscard]] bool is_done() const { return handle_.done(); }
  /// Once it is done.
  [[nodiscard]] const Status& result() const { return handle_.promise().result; }

  bool await_ready() const { return false; }
  std::coroutine_handle<> await_suspend(std::coroutine_handle<> caller) {
    handle_.promise().caller = caller;
    return handle_;
  }
  Status await_resume() { return std::move(handle_.promise().result); }

 private:
  explicit Steps(Handle handle) : handle_(handle) {}
  Handle handle_;
};

}  // namespace heliograph

/// HELIO_TRY in a coroutine.
#define HELIO_CO_TRY(expression)                                  \
  do {                                                            \
    if (auto helio_status = (expression); !helio_status)          \
      co_return std::unexpected(std::move(helio_status).error()); \
  } while (false)
