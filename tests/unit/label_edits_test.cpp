// Labels while editing: automatic ones, classes, and one label for one subtree.
#include "renderer/scene/labels.h"
#include "renderer/scene/scene.h"
#include "tests/unit/stage.h"

using namespace heliograph;
using namespace heliograph::stage;

namespace {

using Kind = LabelPatch::Kind;

PutEntity automatic() { return {.label = LabelPatch{.kind = Kind::kAuto}}; }
PutEntity reset() { return {.label = LabelPatch{}}; }

}  // namespace

TEST_CASE("label edits: a mesh without a labelled ancestor gets the next free label") {
  Stage scene;
  scene({named("tri", triangle()), named("taken", labelled(1)), named("a", showing("tri")),
         named("group", PutEntity{}), named("b", PutEntity{.parent = "group", .mesh = "tri"}),
         named("root", automatic()), named("c", PutEntity{.parent = "root", .mesh = "tri"})});
  CHECK(scene.entity("a").label.value == 2);
  CHECK_FALSE(scene.entity("group").label.set);
  CHECK(scene.entity("b").label.value == 3);
  CHECK(scene.entity("root").label.value == 4);
  CHECK_FALSE(scene.entity("c").label.set);
  scene({named("a", Remove{}), named("d", showing("tri"))});
  CHECK(scene.entity("d").label.value == 5);  // never a number that was in use
}

TEST_CASE("label edits: opting out holds for what is beneath") {
  Stage scene;
  scene({named("tri", triangle()), named("sky", labelled(0)),
         named("cloud", PutEntity{.parent = "sky", .mesh = "tri"}),
         named("own", PutEntity{.mesh = "tri", .label = labelled(0).label})});
  CHECK_FALSE(scene.entity("cloud").label.set);
  CHECK(scene.entity("own").label.set);
  CHECK(scene.now->labels.size() == 0);
  CHECK(label_entities(*scene.now).instances.empty());
}

TEST_CASE("label edits: a category alone leaves the instance as it is") {
  Stage scene;
  scene({named("tri", triangle()), named("a", automatic()), named("b", showing("tri"))});
  scene({named("a", classed("bolt")), named("b", classed("nut")), named("c", classed("bolt"))});
  CHECK(scene.entity("a").label.value == 1);
  CHECK(scene.entity("a").label.category == 1);
  CHECK(scene.entity("b").label.value == 2);
  CHECK(scene.entity("b").label.category == 2);
  CHECK_FALSE(scene.entity("c").label.set);
  CHECK(scene.entity("c").label.category == 1);
  scene({named("a", labelled(9))});
  CHECK(scene.entity("a").label.category == 1);
  scene({named("a", automatic())});
  CHECK(scene.entity("a").label.value == 9);
  scene({named("a", classed("")), named("b", reset())});
  CHECK(scene.entity("a").label == Label{.value = 9, .set = true});
  CHECK(scene.entity("b").label.set);  // it has a mesh
  CHECK(scene.entity("b").label.category == 0);
  scene({named("a", reset())});
  CHECK(scene.entity("a").label == Label{});
}

TEST_CASE("label edits: classes registered beforehand keep their order") {
  Stage scene;
  scene(
      {anonymous(PutSettings{.categories = {"bolt", "nut", "bolt"}}), named("a", classed("nut"))});
  CHECK(*scene.now->categories == std::vector<std::string>{"bolt", "nut"});
  CHECK(scene.entity("a").label.category == 2);
}

TEST_CASE("label edits: one label belongs to one subtree, or to a group") {
  Stage scene;
  scene({named("a", labelled(5)), named("b", PutEntity{}), named("a/x", beneath("a")),
         named("a/y", beneath("a"))});
  const auto refuses = [&](std::vector<Edit> edits, std::string_view where) {
    const Error error = scene.refuses(std::move(edits));
    CHECK(error.code == Code::kInvalidArgument);
    CHECK(error.where == where);
    CHECK(error.message.find("label 5") != std::string::npos);
  };
  refuses({named("b", labelled(5))}, "edits[0].entity.label");
  refuses({named("b", labelled(6)), named("c", labelled(5))}, "edits[1].entity.label");
  scene({named("a/x", labelled(5)), named("a/y", labelled(5))});
  CHECK(*scene.now->labels.find(5) == 3);
  refuses({named("a/x", beneath(Id{}))}, "edits[0].entity.label");
  refuses({named("a", labelled(7))}, "edits[0].entity.label");
  refuses({named("a", Remove{.cascade = true}), named("d", labelled(5)), named("e", labelled(5))},
          "edits[2].entity.label");
  scene({named("b", labelled(5, true))});
  scene({named("c", labelled(5, true))});
  CHECK(*scene.now->labels.find(5) == 5);
  refuses({named("b", labelled(5))}, "edits[0].entity.label");
}

TEST_CASE("label edits: two entities may swap their labels in one transaction") {
  Stage scene;
  scene({named("a", labelled(1)), named("b", labelled(2))});
  scene({named("a", labelled(2)), named("b", labelled(1))});
  CHECK(scene.entity("a").label.value == 2);
  CHECK(scene.entity("b").label.value == 1);
}
