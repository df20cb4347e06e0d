// Read, and the pieces of its answers.
#include "wire/read.h"

#include <cstring>

#include "wire/arrays.h"
#include "wire/session.h"

namespace heliograph::client::wire {
namespace {

void take(const v1::ReadReply& part, Found* found) {
  if (part.has_object()) found->object = part.object();
  if (!part.has_array()) return;
  const v1::Array& array = part.array();
  if (!found->array)
    found->array =
        empty_array(DType(array.dtype()), Shape(array.shape().begin(), array.shape().end()));
  const std::string& bytes = array.inline_();
  if (part.offset() > found->array->bytes() || bytes.size() > found->array->bytes() - part.offset())
    throw ClientError(Code::kInternal,
                      "the daemon sent bytes outside their array; client and "
                      "daemon do not fit together");
  std::memcpy(writable(*found->array) + part.offset(), bytes.data(), bytes.size());
}

}  // namespace

std::vector<Found> read(const SceneCore& scene, const std::vector<Ref>& things,
                        const std::string& field) {
  v1::ReadRequest request;
  request.set_scene(scene.id);
  request.add_fields(field);
  for (const Ref& thing : things) put_ref(thing, nullptr, "refs", request.add_refs());
  std::vector<Found> out(things.size());
  grpc::ClientContext context;
  scene.session->prepare(context);
  const auto reader = scene.session->stub().Read(&context, request);
  for (v1::ReadReply part; reader->Read(&part);)
    if (part.ref() < out.size()) take(part, &out[part.ref()]);
  scene.session->check(reader->Finish());
  return out;
}

Found read(const Handle& handle, const std::string& field) {
  if (!handle)
    throw ClientError(Code::kFailedPrecondition,
                      "this handle is empty; take one from an edit or a scene");
  return read(*handle.node()->scene, {Ref(handle)}, field).front();
}

}  // namespace heliograph::client::wire
