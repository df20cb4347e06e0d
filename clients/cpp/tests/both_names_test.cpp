// The C++ client in a program beside the renderer: each has its own Camera, Transaction and Code.
#include <heliograph/heliograph.h>

#include <type_traits>

#include "renderer/base/error.h"
#include "renderer/scene/components.h"
#include "renderer/scene/transaction.h"
#include "tests/unit/catch.h"

TEST_CASE("names: the client's types are not the renderer's") {
  using namespace heliograph;
  STATIC_REQUIRE(!std::is_same_v<Camera, client::Camera>);
  STATIC_REQUIRE(!std::is_same_v<Transaction, client::Transaction>);
  STATIC_REQUIRE(!std::is_same_v<Code, client::Code>);
  const client::Camera theirs = client::Camera::from_fov(1.0, 64, 48);
  CHECK(theirs.width == 64);
  CHECK(Camera{.width = 32}.width == 32);
  CHECK(client::ClientError(client::Code::kNotFound, "gone; look again").remedy() == "look again");
  CHECK(fail(Code::kNotFound, "", "gone").error().code == Code::kNotFound);
}
