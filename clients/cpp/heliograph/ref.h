// Handle: one object of a scene; Ref: a handle or a name, interchangeable in every call.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

namespace heliograph::client {

namespace wire {
struct Node;
}

/// Kind of an object, as in the upper 8 bits of its id.
enum class Kind : int { kEntity = 1, kMesh = 2, kMaterial = 3, kTexture = 4, kVolume = 5 };

/// Handle of an object in a scene. Its id is known once its transaction was committed. Copies
/// denote the same object and keep their scene alive. Thread: any.
class Handle {
 public:
  Handle() = default;  // no object
  explicit Handle(std::shared_ptr<wire::Node> node) : node_(std::move(node)) {}

  explicit operator bool() const { return node_ != nullptr; }

  /// Its 64-bit id: kind, index, version. Asks the daemon where only the name is known.
  [[nodiscard]] std::uint64_t id() const;
  [[nodiscard]] const std::string& name() const;
  [[nodiscard]] Kind kind() const;

  [[nodiscard]] const std::shared_ptr<wire::Node>& node() const { return node_; }

 private:
  std::shared_ptr<wire::Node> node_;
};

class Ref {
 public:
  Ref(const Handle& handle) : handle_(handle) {}
  Ref(std::string name) : name_(std::move(name)) {}
  Ref(const char* name) : name_(name) {}

  [[nodiscard]] const Handle& handle() const { return handle_; }  // empty: the name counts
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  Handle handle_;
  std::string name_;
};

}  // namespace heliograph::client
