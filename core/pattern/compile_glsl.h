// glslang behind one function, and its results kept on disk.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace encore {

// compileGlsl() for text that may be wrong: words, or the step that failed ("compile", "link", …) and glslang's log.
struct GlslResult {
  std::vector<uint32_t> spirv;  // empty: it failed
  std::string failed_step, log;
};
GlslResult tryCompileGlsl(const std::string& source, const std::string& name);

// What decides the result besides the source: our own version and glslang's, and all text that may be included.
const std::string& glslFingerprint();

// Results of tryCompileGlsl() in a folder, one file for each. Whatever is wrong with a file or the folder, the result
// is that of compiling: files that are broken, of other versions or of other sources are written anew.
class ShaderCache {
 public:
  explicit ShaderCache(std::string folder) : folder_(std::move(folder)) {}  // empty: nothing is kept
  GlslResult compile(const std::string& source, const std::string& name) const;

 private:
  std::string folder_;
};

}  // namespace encore
