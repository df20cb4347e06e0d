#include <assimp/MemoryIOWrapper.h>
#include <assimp/ZipArchiveIOSystem.h>
#include <assimp/config.h>
#include <assimp/postprocess.h>

#include <array>
#include <assimp/DefaultLogger.hpp>
#include <cmath>
#include <pugixml.hpp>

#include "renderer/assets/assimp/scene.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets::assimp {
namespace {

/// The model alone: whatever else a reader asks for is not there.
class OneFile : public Assimp::IOSystem {
 public:
  OneFile(std::string name, std::span<const std::byte> bytes)
      : name_(std::move(name)), bytes_(bytes) {}

  bool Exists(const char* path) const override { return name_ == path; }
  char getOsSeparator() const override { return '/'; }
  Assimp::IOStream* Open(const char* path, const char*) override {
    if (!Exists(path)) return nullptr;
    return new Assimp::MemoryIOStream(reinterpret_cast<const u8*>(bytes_.data()), bytes_.size());
  }
  void Close(Assimp::IOStream* file) override { delete file; }

 private:
  const std::string name_;
  const std::span<const std::byte> bytes_;
};

/// Passes on as warnings what a reader reports that it leaves out or mends.
class Said : public Assimp::Logger {
 public:
  explicit Said(Builder& builder) : builder_(builder) {}

  bool attachStream(Assimp::LogStream*, u32) override { return false; }
  bool detachStream(Assimp::LogStream*, u32) override { return false; }

 protected:
  void OnDebug(const char*) override {}
  void OnVerboseDebug(const char*) override {}
  void OnInfo(const char*) override {}
  void OnWarn(const char* message) override { warn(message); }
  void OnError(const char* message) override { warn(message); }

 private:
  void warn(std::string_view message) {
    constexpr u32 kMost = 20;
    constexpr std::array<std::string_view, 3> kNothingLost = {
        "Validation warning", "newer format version", "Ignored file of un"};
    for (const std::string_view part : kNothingLost)
      if (message.find(part) != message.npos) return;
    if (++count_ <= kMost) builder_.warn(fmt::format("the reader says: {}", message));
  }

  Builder& builder_;
  u32 count_ = 0;
};

/// The library has one logger, which it owns.
class Listening {
 public:
  explicit Listening(Builder& builder) { Assimp::DefaultLogger::set(new Said(builder)); }
  ~Listening() { Assimp::DefaultLogger::set(nullptr); }
  Listening(const Listening&) = delete;
  Listening& operator=(const Listening&) = delete;
};

std::string name_of(const std::string& format) { return "model." + format; }

struct Custom {
  const char* format;
  const char* up;
};
/// The up axis that readers of these formats assume.
constexpr std::array kCustoms =
    std::to_array<Custom>({{"3ds", "z"}, {"3mf", "z"}, {"x", "y"}, {"off", "z"}, {"amf", "z"}});

/// Metres of a unit by its name. Source: 3MF core specification 1.3, 3.4 (model); ISO/ASTM 52915,
/// "amf".
double metres_of(std::string_view unit) {
  if (unit == "micron" || unit == "micrometer") return 1e-6;
  if (unit == "centimeter") return 1e-2;
  if (unit == "inch") return 0.0254;
  if (unit == "foot" || unit == "feet") return 0.3048;
  if (unit == "meter") return 1;
  return 1e-3;
}

/// The value of `unit` in the first element of an XML, which may be cut off behind it.
std::string unit_of(std::string_view head, const std::string& element) {
  const std::size_t start = std::min(head.find("<" + element), head.size());
  head = head.substr(start, head.find('>', start) + 1 - start);
  pugi::xml_document xml;
  (void)xml.load_buffer(head.data(), head.size());
  return lower(xml.child(element.c_str()).attribute("unit").value());
}

/// The beginning of a 3MF's model.
std::string head_of_3mf(std::span<const std::byte> bytes) {
  constexpr std::size_t kLooked = 4096;
  OneFile files(name_of("3mf"), bytes);
  Assimp::ZipArchiveIOSystem archive(&files, name_of("3mf"));
  std::vector<std::string> names;
  archive.getFileListExtension(names, "model");
  std::string head(kLooked, ' ');
  if (names.empty()) return "";
  Assimp::IOStream* file = archive.Open(names.front().c_str());
  if (!file) return "";
  head.resize(file->Read(head.data(), 1, head.size()));
  archive.Close(file);
  return head;
}

/// Centimetres, which the file's settings state.
double unit_of_fbx(const aiScene& scene) {
  float unit = 1;
  if (scene.mMetaData) scene.mMetaData->Get("UnitScaleFactor", unit);
  if (!(unit > 0 && std::isfinite(unit)))
    refuse("GlobalSettings.UnitScaleFactor", "must be above 0; give units=");
  return unit;
}

double metres_of_model(const aiScene& scene, const Builder& builder) {
  const std::string& format = builder.format;
  const std::span<const std::byte> bytes = builder.bundle.model().bytes;
  if (format == "3mf") return metres_of(unit_of(head_of_3mf(bytes), "model"));
  if (format == "amf") return metres_of(unit_of(as_text(bytes), "amf"));
  return format == "fbx" ? 0.01 * unit_of_fbx(scene) : 1;
}

}  // namespace

const aiScene& import_scene(Assimp::Importer& importer, Builder& builder) {
  const std::string name = name_of(builder.format);
  importer.SetIOHandler(new OneFile(name, builder.bundle.model().bytes));
  importer.SetPropertyBool(AI_CONFIG_IMPORT_FBX_PRESERVE_PIVOTS, false);
  importer.SetPropertyBool(AI_CONFIG_IMPORT_REMOVE_EMPTY_BONES, false);
  const Listening listening(builder);
  const aiScene* scene =
      importer.ReadFile(name, aiProcess_JoinIdenticalVertices | aiProcess_ValidateDataStructure);
  if (scene && scene->mRootNode) return *scene;
  const std::string error = importer.GetErrorString();
  if (error.find("bad_alloc") != error.npos) throw std::bad_alloc();
  refuse("", error.empty() ? "holds nothing" : error);
}

mat4x3 world_from_scene(const aiScene& scene, const Builder& builder) {
  const std::string& format = builder.format;
  const LoadOptions& options = builder.options;
  mat3 turn(1);
  const double metres = options.units > 0 ? options.units : metres_of_model(scene, builder);
  if (format == "fbx") {  // the root's pose turns the file's axes to +Y up
    turn = z_up_from("y") * mat3(matrix_of(scene.mRootNode->mTransformation));
  } else {
    turn = z_up_from(std::ranges::find(kCustoms, format, &Custom::format)->up);
  }
  if (!options.up.empty()) turn = z_up_from(options.up);
  const mat3 file_from_scene = format == "3ds" ? z_up_from("y") : mat3(1);
  return mat4x3(mat4(float(metres) * turn * file_from_scene));
}

}  // namespace heliograph::assets::assimp
