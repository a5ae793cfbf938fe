#include "core/pattern/compile_glsl.h"

#include <glslang/Public/ResourceLimits.h>
#include <glslang/Public/ShaderLang.h>
#include <glslang/SPIRV/GlslangToSpv.h>

#include <algorithm>
#include <iterator>
#include <memory>
#include <string_view>

#include "core/pattern/patterns.h"
#include "core/scene/error.h"

namespace encore {
namespace {

// The files below shaders/ that generated code may include, by name; CMake writes them into the build.
struct GlslText {
  std::string_view name, text;
};
constexpr GlslText kGlslTexts[] = {
#include "pattern/glsl_texts.inc"
};

class Includer : public glslang::TShader::Includer {
 public:
  IncludeResult* includeLocal(const char* name, const char*, size_t) override {
    const auto found = std::find_if(std::begin(kGlslTexts), std::end(kGlslTexts),
                                    [&](const GlslText& file) { return file.name == name; });
    if (found == std::end(kGlslTexts)) return nullptr;  // glslang reports it
    results_.push_back(std::make_unique<IncludeResult>(name, found->text.data(), found->text.size(), nullptr));
    return results_.back().get();
  }
  void releaseInclude(IncludeResult*) override {}  // they live as long as the includer

 private:
  std::vector<std::unique_ptr<IncludeResult>> results_;
};

// glslang's tables, made on first use and kept: making them takes longer than most shaders.
void initializeGlslang() {
  struct Process {
    Process() { glslang::InitializeProcess(); }
    ~Process() { glslang::FinalizeProcess(); }
  };
  static const Process process;
}

// Part of every cache file's key: raise it when the options below change.
constexpr int kOptionsVersion = 1;

}  // namespace

GlslResult tryCompileGlsl(const std::string& source, const std::string& name) {
  initializeGlslang();
  const char* const text = source.c_str();
  const char* const text_name = name.c_str();
  const int text_length = int(source.size());
  constexpr EShMessages kMessages = EShMessages(EShMsgSpvRules | EShMsgVulkanRules);

  Includer includer;  // outlives the shader
  glslang::TShader shader(EShLangCompute);
  shader.setStringsWithLengthsAndNames(&text, &text_length, &text_name, 1);
  shader.setEnvInput(glslang::EShSourceGlsl, EShLangCompute, glslang::EShClientVulkan, 460);
  shader.setEnvClient(glslang::EShClientVulkan, glslang::EShTargetVulkan_1_3);
  shader.setEnvTarget(glslang::EShTargetSpv, glslang::EShTargetSpv_1_6);
  if (!shader.parse(GetDefaultResources(), 460, false, kMessages, includer))
    return {{}, "compile", shader.getInfoLog()};

  glslang::TProgram program;
  program.addShader(&shader);
  if (!program.link(kMessages)) return {{}, "link", program.getInfoLog()};

  GlslResult result;
  spv::SpvBuildLogger logger;
  glslang::SpvOptions options;
  options.disableOptimizer = true;  // the driver's does the same work again
  glslang::GlslangToSpv(*program.getIntermediate(EShLangCompute), result.spirv, &logger, &options);
  if (result.spirv.empty()) return {{}, "translate to SPIR-V", logger.getAllMessages()};
  return result;
}

std::vector<uint32_t> compileGlsl(const std::string& source, const std::string& name) {
  GlslResult result = tryCompileGlsl(source, name);
  if (result.spirv.empty())
    throw Error(ErrorKind::Internal, "the shader does not " + result.failed_step + ":\n" + result.log, name,
                "Report this with the scene that caused it");
  return std::move(result.spirv);
}

const std::string& glslFingerprint() {
  static const std::string fingerprint = [] {
    const glslang::Version version = glslang::GetVersion();
    std::string text = "encore " + std::to_string(kOptionsVersion) + ", glslang " + std::to_string(version.major) +
                       "." + std::to_string(version.minor) + "." + std::to_string(version.patch) + version.flavor +
                       "\n";
    for (const GlslText& file : kGlslTexts) text.append(file.name).append("\n").append(file.text);
    return text;
  }();
  return fingerprint;
}

}  // namespace encore
