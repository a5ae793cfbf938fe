#include "core/pattern/patterns.h"

#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <optional>
#include <set>
#include <utility>

#include "core/pattern/compile_glsl.h"
#include "core/pattern/fingerprint.h"
#include "core/pattern/network.h"
#include "core/pattern/pattern_cache.h"
#include "core/pattern/texture_nodes.h"
#include "core/pattern/texture_store.h"
#include "core/scene/error.h"

namespace encore {
namespace {

constexpr uint32_t kLocalSize = 64;  // of evaluate.glsl
constexpr uint32_t kNoProgram = 0xffffffffu;

template <class Outputs>
constexpr size_t kFloats = sizeof(Outputs) / sizeof(float);  // records of values hold nothing else

// Push constants of evaluate.glsl.
struct Arguments {
  uint64_t points, data, values, order, textures, nodes, tables;
  uint32_t count, ordered;
};

// An eighth of the smaller of the machine's and the device's memory.
uint64_t defaultBudget(const Device& device) {
  const uint64_t machine = uint64_t(sysconf(_SC_PHYS_PAGES)) * uint64_t(sysconf(_SC_PAGE_SIZE));
  return std::min(machine, device.info().memory_bytes) / 8;
}

// glslang's log in the user's terms: lines are those of the file, parameters go by their names.
std::string translateLog(const GlslShader& shader, const std::string& log) {
  const std::string error = "ERROR: ", user = kUserFile, parameter = kParameterFile;
  std::string text;
  for (size_t begin = 0; begin < log.size();) {
    const size_t end = std::min(log.find('\n', begin), log.size());
    std::string line = log.substr(begin, end - begin);
    begin = end + 1;
    if (line.rfind(error, 0) == 0) line.erase(0, error.size());
    if (line.find("compilation errors.  No code generated.") != std::string::npos) continue;
    if (line.rfind(user, 0) == 0)
      line.replace(0, user.size(), shader.file);
    else if (line.rfind(kGeneratedFile, 0) == 0)
      line.replace(0, line.find(' '), shader.file + ", after its end:");
    else if (line.rfind(parameter, 0) == 0)
      line.replace(0, parameter.size(), "parameter ");
    if (line.find_first_not_of(" \t\r") != std::string::npos) text += "\n  " + line;
  }
  return text;
}

[[noreturn]] void raiseBroken(const PatternProgram& program, const std::string& name, const GlslResult& result) {
  if (!program.shader)
    throw Error(ErrorKind::Internal, "the shader does not " + result.failed_step + ":\n" + result.log, name,
                "Report this with the scene that caused it");
  const char* entry = program.displacement
                          ? "void displacement(in DisplacementPoint, inout vec3 offset, inout float along_normal)"
                          : "void surface(in SurfacePoint, inout Surface)";
  throw Error(ErrorKind::Scene,
              "the shader does not " + result.failed_step + ":" + translateLog(*program.shader, result.log),
              program.shader->path,
              "It must define " + std::string(entry) + " and close what it opens; docs/glsl.md lists what it may use");
}

std::vector<uint32_t> compileProgram(const ShaderCache& cache, const PatternProgram& program, const std::string& name) {
  GlslResult result = cache.compile(program.source, name);
  if (result.spirv.empty()) raiseBroken(program, name, result);
  return std::move(result.spirv);
}

std::string keyOf(const std::string& name, const PatternProgram& program) { return name + "\n" + program.source; }

// Programs to kernels, unless a scene before has left them.
class Compiler {
 public:
  Compiler(Device& device, std::string folder, PatternCache* cache)
      : device_(device), shaders_(folder), cache_(cache) {}

  std::shared_ptr<const Kernel> kernel(const PatternProgram& program, const std::string& name) const {
    const std::string key = keyOf(name, program);
    if (cache_ && cache_->knows(key)) return cache_->program(key);
    const auto kernel = std::make_shared<const Kernel>(device_, name, compileProgram(shaders_, program, name));
    if (cache_) cache_->addProgram(key, kernel);
    return kernel;
  }
  // Throws where it does not compile.
  void check(const PatternProgram& program, const std::string& name) const {
    const std::string key = keyOf(name, program);
    if (cache_ && cache_->knows(key)) return;
    compileProgram(shaders_, program, name);
    if (cache_) cache_->addProgram(key, nullptr);
  }

 private:
  Device& device_;
  ShaderCache shaders_;
  PatternCache* cache_;
};

// One part of all materials: its constants, its programs, and the buffers of its batches.
class Part {
 public:
  Part(PatternPart part, size_t record_floats, const Scene& scene) : part_(part), floats_(record_floats) {
    for (const Material& material : scene.materials) {
      const Network network = makeNetwork(part, material);
      constants_.push_back(constantValues(part, material));
      layouts_.push_back(makeLayout(part, material, network));
      program_of_.push_back(kNoProgram);
    }
  }

  void setPrograms(std::vector<PatternProgram> programs) {
    for (PatternProgram& program : programs) {
      for (uint32_t material : program.materials) program_of_[material] = uint32_t(programs_.size());
      programs_.push_back({std::move(program), nullptr});
    }
  }
  void setTextures(Device& device, const Scene& scene, const TextureLayout& layout, std::vector<TextureTile>& tiles) {
    textures_.emplace(device, part_, scene, layout, tiles);
  }
  void addProgramKeys(std::set<std::string>& keys) const {
    for (const Program& program : programs_) keys.insert(keyOf(name(), program.text));
  }
  // Those that a user wrote, so that what is wrong with them is known early. Others are compiled at first use.
  void compileShaders(const Compiler& compiler) {
    for (Program& program : programs_)
      if (program.text.shader) compile(compiler, program);
  }

  bool varies(int32_t material) const { return program_of_.at(size_t(material)) != kNoProgram; }
  const PointLayout& layout(int32_t material) const { return layouts_.at(size_t(material)); }
  template <class Outputs>
  Outputs constant(size_t material) const {
    std::array<float, kFloats<Outputs>> values;
    std::copy_n(constants_.at(material).begin(), values.size(), values.begin());
    return std::bit_cast<Outputs>(values);
  }

  PatternFingerprint fingerprint(const Scene& scene, int32_t index) const {
    const Material& material = scene.materials.at(size_t(index));
    PatternFingerprint print;
    FingerprintText text(print.text);
    text.add(constants_[size_t(index)].data(), constants_[size_t(index)].size() * sizeof(float));
    if (!varies(index)) return print;
    text.add(uint32_t(index));
    text.add(programs_[program_of_[size_t(index)]].text.source);
    for (const PointSlot& slot : layout(index).slots) {
      text.add(uint32_t(slot.kind)), text.add(slot.name);
      text.add(slot.fallback.data(), sizeof slot.fallback);
    }
    for (const int32_t n : textureNodes(material, makeNetwork(part_, material)))
      if (!addTextureNode(scene, material.nodes[size_t(n)], text, print.textures)) return {};
    return print;
  }

  void evaluate(Device& device, const Compiler& compiler, TextureStore& textures, const PatternPoints& points,
                std::span<std::byte> values) {
    const size_t record_bytes = floats_ * sizeof(float);
    if (points.size() * record_bytes != values.size() || points.size() > 0xffffffffu)
      throw Error(ErrorKind::Internal, "a batch of " + std::to_string(points.size()) + " points came with room for " +
                                           std::to_string(values.size() / record_bytes) + " values");
    if (points.empty()) return;
    sortByProgram(points);
    for (uint32_t p = 0; p < programs_.size(); ++p)
      if (batchSize(p) > 0) compile(compiler, programs_[p]);
    upload(device, points);
    dispatch(device, textures);
    // All levels that the batch wants are resident now, unless they were before.
    if (!textures.endBatch()) {
      dispatch(device, textures);
      if (!textures.endBatch()) throw Error(ErrorKind::Internal, "a second try found texture levels missing");
    }
    values_.toHost(0, points.size() * floats_);
    std::memcpy(values.data(), values_.host().data(), values.size());
  }

 private:
  struct Program {
    PatternProgram text;
    std::shared_ptr<const Kernel> kernel;  // null: not compiled yet
  };

  std::string name() const {
    constexpr std::array<const char*, kPatternParts> kNames{"pattern_shading", "pattern_path", "pattern_opacity",
                                                            "pattern_displacement"};
    return kNames[size_t(part_)];
  }

  void compile(const Compiler& compiler, Program& program) {
    if (!program.kernel) program.kernel = compiler.kernel(program.text, name());
  }

  // Where the points of each program begin in the order of evaluation. Points keep their order within a program.
  void sortByProgram(const PatternPoints& points) {
    first_.assign(programs_.size() + 1, 0);
    for (const PatternPoint& point : points.point) {
      if (point.material >= program_of_.size() || program_of_[point.material] == kNoProgram)
        throw Error(ErrorKind::Internal,
                    "material " + std::to_string(point.material) + " was evaluated, but has no varying input");
      if (uint64_t(point.first) + layouts_[point.material].size > points.data.size())
        throw Error(ErrorKind::Internal, "a point of material " + std::to_string(point.material) + " lacks its data");
      ++first_[program_of_[point.material] + 1];
    }
    uint32_t used = 0;
    for (size_t p = 0; p < programs_.size(); ++p) {
      used += first_[p + 1] > 0;
      first_[p + 1] += first_[p];
    }
    order_.clear();
    if (used < 2) return;  // as they come
    order_.resize(points.size());
    std::vector<uint32_t> next(first_.begin(), first_.end() - 1);
    for (uint32_t i = 0; i < points.size(); ++i) order_[next[program_of_[points.point[i].material]]++] = i;
  }
  uint32_t batchSize(uint32_t program) const { return first_[program + 1] - first_[program]; }

  // Buffers grow in steps of a half, so that slowly growing batches do not allocate every time.
  template <class T>
  static void grow(Device& device, Buffer<T>& buffer, size_t size, const char* name) {
    if (size > buffer.size()) buffer.reserve(device, std::max(size, buffer.size() + buffer.size() / 2), name);
  }
  template <class T>
  static void fill(Device& device, Buffer<T>& buffer, const std::vector<T>& values, const char* name) {
    if (values.empty()) return;
    grow(device, buffer, values.size(), name);
    std::memcpy(buffer.host().data(), values.data(), values.size() * sizeof(T));
    buffer.toDevice(0, values.size());
  }
  void upload(Device& device, const PatternPoints& points) {
    fill(device, points_, points.point, "pattern points");
    fill(device, data_, points.data, "pattern data");
    fill(device, order_buffer_, order_, "pattern order");
    grow(device, values_, points.size() * floats_, "pattern values");
  }

  void dispatch(Device& device, TextureStore& textures) {
    textures.beginBatch();
    Commands commands(device);
    for (uint32_t p = 0; p < programs_.size(); ++p) {
      if (batchSize(p) == 0) continue;
      const uint64_t order = order_.empty() ? 0 : order_buffer_.address(first_[p]);
      commands.dispatch(
          *programs_[p].kernel, groupsFor(batchSize(p), kLocalSize),
          Arguments{points_.address(), data_.address(), values_.address(), order, textures_->rangesAddress(),
                    textures_->nodesAddress(), textures.tablesAddress(), batchSize(p), order_.empty() ? 0u : 1u});
    }
    commands.run();
  }

  PatternPart part_;
  size_t floats_;  // of a record of values
  std::vector<std::vector<float>> constants_;
  std::vector<PointLayout> layouts_;
  std::vector<uint32_t> program_of_;  // per material, or kNoProgram
  std::vector<Program> programs_;
  std::optional<TextureNodeTable> textures_;
  std::vector<uint32_t> first_, order_;  // of the batch: see sortByProgram()
  Buffer<PatternPoint> points_;
  Buffer<float> data_, values_;
  Buffer<uint32_t> order_buffer_;
};

template <class Outputs>
std::vector<Outputs> constantTable(const Part& part, size_t materials) {
  std::vector<Outputs> table;
  for (size_t m = 0; m < materials; ++m) table.push_back(part.constant<Outputs>(m));
  return table;
}

}  // namespace

struct Patterns::Impl {
  Impl(Device& on, const Scene& of, const Settings& settings, PatternCache* cache)
      : device(on),
        scene(of),
        compiler(on, settings.shader_cache, cache),
        parts{Part(PatternPart::Shading, kFloats<ShadingInputs>, scene),
              Part(PatternPart::Path, kFloats<PathInputs>, scene),
              Part(PatternPart::Opacity, kFloats<OpacityInputs>, scene),
              Part(PatternPart::Displacement, kFloats<DisplacementInputs>, scene)} {
    const size_t materials = scene.materials.size();
    shading = constantTable<ShadingInputs>(part(PatternPart::Shading), materials);
    path = constantTable<PathInputs>(part(PatternPart::Path), materials);
    opacity = constantTable<OpacityInputs>(part(PatternPart::Opacity), materials);
    displacement = constantTable<DisplacementInputs>(part(PatternPart::Displacement), materials);

    PatternSource source = generatePatterns(scene);
    std::set<std::string> programs;
    for (const PatternProgram& program : source.idle) programs.insert(keyOf(kIdle, program));
    const TextureLayout layout = layoutTextures(scene);
    std::vector<TextureTile> tiles;
    for (uint32_t p = 0; p < kPatternParts; ++p) {
      parts[p].setPrograms(std::move(source.parts[p]));
      parts[p].setTextures(device, scene, layout, tiles);
      parts[p].addProgramKeys(programs);
    }
    if (cache) cache->retainPrograms(programs);
    for (const PatternProgram& program : source.idle) compiler.check(program, kIdle);
    for (Part& p : parts) p.compileShaders(compiler);
    const uint64_t budget = settings.texture_budget_bytes;
    // Only a budget that was asked for is a hard one: the default grows to half of the memory before it fails.
    const uint64_t given = budget ? budget : defaultBudget(device);
    textures.emplace(device, scene, layout, tiles, given, budget ? budget : 4 * given, cache);

    for (size_t m = 0; m < materials; ++m) {
      normal_texcoords.push_back(normalTexcoordOf(scene.materials[m]));
      for (PatternPart p : {PatternPart::Shading, PatternPart::Path, PatternPart::Opacity})
        for (const PointSlot& slot : part(p).layout(int32_t(m)).slots)
          reads_textures = reads_textures || slot.kind == PointSlot::Kind::Texcoord;
    }
  }

  Part& part(PatternPart p) { return parts[size_t(p)]; }
  template <class Outputs>
  void evaluate(PatternPart p, const PatternPoints& points, std::span<Outputs> values) {
    part(p).evaluate(device, compiler, *textures, points, std::as_writable_bytes(values));
  }

  static constexpr const char* kIdle = "pattern_idle";
  Device& device;
  const Scene& scene;
  Compiler compiler;
  std::array<Part, kPatternParts> parts;
  std::optional<TextureStore> textures;
  std::vector<ShadingInputs> shading;
  std::vector<PathInputs> path;
  std::vector<OpacityInputs> opacity;
  std::vector<DisplacementInputs> displacement;
  std::vector<std::string> normal_texcoords;
  bool reads_textures = false;
};

Patterns::Patterns(Device& device, const Scene& scene, const Settings& settings, PatternCache* cache)
    : impl_(std::make_unique<Impl>(device, scene, settings, cache)) {}
Patterns::~Patterns() = default;

bool Patterns::varies(PatternPart part, int32_t material) const { return impl_->part(part).varies(material); }
const PointLayout& Patterns::layout(PatternPart part, int32_t material) const {
  return impl_->part(part).layout(material);
}
const ShadingInputs& Patterns::constantShading(int32_t material) const { return impl_->shading.at(size_t(material)); }
const PathInputs& Patterns::constantPath(int32_t material) const { return impl_->path.at(size_t(material)); }
float Patterns::constantOpacity(int32_t material) const { return impl_->opacity.at(size_t(material)).opacity; }
const DisplacementInputs& Patterns::constantDisplacement(int32_t material) const {
  return impl_->displacement.at(size_t(material));
}
const std::string& Patterns::normalTexcoord(int32_t material) const {
  return impl_->normal_texcoords.at(size_t(material));
}
PatternFingerprint Patterns::fingerprint(PatternPart part, int32_t material) const {
  return impl_->part(part).fingerprint(impl_->scene, material);
}
bool Patterns::readsTextures() const { return impl_->reads_textures; }

void Patterns::evaluate(const PatternPoints& points, std::span<ShadingInputs> values) {
  impl_->evaluate(PatternPart::Shading, points, values);
}
void Patterns::evaluate(const PatternPoints& points, std::span<PathInputs> values) {
  impl_->evaluate(PatternPart::Path, points, values);
}
void Patterns::evaluate(const PatternPoints& points, std::span<OpacityInputs> values) {
  impl_->evaluate(PatternPart::Opacity, points, values);
}
void Patterns::evaluate(const PatternPoints& points, std::span<DisplacementInputs> values) {
  impl_->evaluate(PatternPart::Displacement, points, values);
}

uint64_t Patterns::textureBytes() const { return impl_->textures->bytes(); }
uint64_t Patterns::peakTextureBytes() const { return impl_->textures->peakBytes(); }

}  // namespace encore
