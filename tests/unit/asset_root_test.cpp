#include "server/store/asset_root.h"

#include <sys/stat.h>

#include <filesystem>
#include <fstream>

#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
namespace fs = std::filesystem;

namespace {

/// A folder "root" with good.glb in it, and secret.txt beside it.
class Tree {
 public:
  Tree() : top_(fs::temp_directory_path() / ("hg-root-" + std::to_string(::getpid()))) {
    fs::create_directories(root() / "models");
    std::ofstream(root() / "models/good.glb") << "glTF";
    std::ofstream(top_ / "secret.txt") << "secret";
  }
  ~Tree() { fs::remove_all(top_); }
  [[nodiscard]] fs::path top() const { return top_; }
  [[nodiscard]] fs::path root() const { return top_ / "root"; }

 private:
  fs::path top_;
};

}  // namespace

TEST_CASE("asset root: a file beneath it is read whole") {
  const Tree tree;
  const auto root = AssetRoot::open(tree.root());
  REQUIRE(root);
  const auto file = root->find("models/good.glb", 100);
  REQUIRE(file);
  CHECK(file->size == 4);
  const auto bytes = file->read();
  REQUIRE(bytes);
  CHECK((*bytes)->bytes().size() == 4);
  CHECK(root->find("models/good.glb", 3).error().code == Code::kResourceExhausted);
  fs::resize_file(tree.root() / "models/good.glb", 2);
  CHECK(root->find("models/good.glb", 100)->size == 2);
  CHECK(file->read().error().code == Code::kUnavailable);
}

TEST_CASE("asset root: every way out is refused in the words of a missing file") {
  const Tree tree;
  const fs::path root_folder = tree.root();
  fs::create_symlink(tree.top() / "secret.txt", root_folder / "link");
  fs::create_symlink("models/good.glb", root_folder / "inner_link");
  fs::create_directory_symlink(tree.top(), root_folder / "up");
  fs::create_hard_link(tree.top() / "secret.txt", root_folder / "hard");
  REQUIRE(::mkfifo((root_folder / "pipe").c_str(), 0600) == 0);
  const auto root = AssetRoot::open(root_folder);
  REQUIRE(root);
  const auto missing = root->find("nothing.glb", 100).error();
  for (const std::string& path :
       {std::string("../secret.txt"), std::string("models/../../secret.txt"),
        (tree.top() / "secret.txt").string(), std::string("link"), std::string("inner_link"),
        std::string("up/secret.txt"), std::string("hard"), std::string("pipe"),
        std::string("models"), std::string(""), std::string("."), std::string("/dev/null"),
        std::string("/proc/self/environ"), std::string("file:models/good.glb"),
        std::string("%2e%2e/secret.txt"), std::string("models/good.glb\0x", 17)}) {
    INFO(path);
    const auto result = root->find(path, 100);
    REQUIRE(!result);
    CHECK(result.error().code == Code::kNotFound);
    CHECK(result.error().message == missing.message);
  }
}

TEST_CASE("asset root: without one nothing is read") {
  CHECK(AssetRoot().find("models/good.glb", 100).error().code == Code::kPermissionDenied);
  CHECK(AssetRoot::open("/no/such/folder").error().code == Code::kInvalidArgument);
}
