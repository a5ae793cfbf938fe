// ShaderCache. A file is
//   8 bytes   magic
//   uint64 × 3  bytes of the key, words of SPIR-V, checksum of both
//   the key   everything that the result depends on: compared in full, so that equal hashes do no harm
//   the words
// in the byte order of the machine. Its name is a hash of the key.
#include <array>
#include <atomic>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <span>
#include <system_error>

#include "core/pattern/compile_glsl.h"

namespace encore {
namespace {

namespace fs = std::filesystem;

constexpr std::array<char, 8> kMagic{'E', 'N', 'C', 'S', 'P', 'V', '0', '1'};
struct Header {
  std::array<char, 8> magic;
  uint64_t key_bytes, words, checksum;
};

// FNV-1a.
uint64_t hash(std::span<const char> bytes, uint64_t state = 0xcbf29ce484222325u) {
  for (char byte : bytes) state = (state ^ uint8_t(byte)) * 0x100000001b3u;
  return state;
}
uint64_t checksum(const std::string& key, std::span<const uint32_t> words) {
  return hash({reinterpret_cast<const char*>(words.data()), words.size_bytes()}, hash(key));
}

fs::path pathOf(const std::string& folder, const std::string& key) {
  std::array<char, 17> name;
  std::snprintf(name.data(), name.size(), "%016llx", static_cast<unsigned long long>(hash(key)));
  return fs::path(folder) / (std::string(name.data()) + ".spv");
}

// The words of a file that is whole and made for this key; else none.
std::vector<uint32_t> load(const fs::path& path, const std::string& key) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return {};
  const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  Header header;
  if (bytes.size() < sizeof(header)) return {};
  std::memcpy(&header, bytes.data(), sizeof(header));
  if (header.magic != kMagic || header.key_bytes != key.size() || header.words == 0 ||
      header.words > bytes.size() / sizeof(uint32_t) ||
      bytes.size() != sizeof(header) + key.size() + header.words * sizeof(uint32_t) ||
      bytes.compare(sizeof(header), key.size(), key) != 0)
    return {};
  std::vector<uint32_t> words(header.words);
  std::memcpy(words.data(), bytes.data() + sizeof(header) + key.size(), words.size() * sizeof(uint32_t));
  return checksum(key, words) == header.checksum ? words : std::vector<uint32_t>{};
}

// Under a name of its own, then renamed: readers see a whole file or none. Failures leave no file.
void store(const fs::path& path, const std::string& key, std::span<const uint32_t> words) {
  static std::atomic<uint32_t> count = 0;
  std::error_code ignored;
  fs::create_directories(path.parent_path(), ignored);
  const fs::path temporary =
      path.string() + "." + std::to_string(std::random_device{}()) + "." + std::to_string(count++) + ".tmp";
  const Header header{kMagic, key.size(), words.size(), checksum(key, words)};
  std::ofstream file(temporary, std::ios::binary);
  file.write(reinterpret_cast<const char*>(&header), sizeof(header));
  file.write(key.data(), std::streamsize(key.size()));
  file.write(reinterpret_cast<const char*>(words.data()), std::streamsize(words.size_bytes()));
  file.close();
  std::error_code failed;
  if (file) fs::rename(temporary, path, failed);
  if (!file || failed) fs::remove(temporary, ignored);
}

}  // namespace

GlslResult ShaderCache::compile(const std::string& source, const std::string& name) const {
  if (folder_.empty()) return tryCompileGlsl(source, name);
  const std::string key = glslFingerprint() + source;
  const fs::path path = pathOf(folder_, key);
  if (std::vector<uint32_t> words = load(path, key); !words.empty()) return {std::move(words), {}, {}};
  GlslResult result = tryCompileGlsl(source, name);
  if (!result.spirv.empty()) store(path, key, result.spirv);
  return result;
}

}  // namespace encore
