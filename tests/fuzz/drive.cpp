// Fuzz targets without a fuzzer. Seeded random bytes: [--count N]
// [--seed S], or the files that a fuzzer left.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "promise.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

int main(int argc, char** argv) {
  long count = 20000;
  unsigned long seed = 1;
  bool files = false;
  std::string scene;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--count") == 0 && i + 1 < argc) {
      count = std::strtol(argv[++i], nullptr, 10);
    } else if (std::strcmp(argv[i], "--seed") == 0 && i + 1 < argc) {
      seed = std::strtoul(argv[++i], nullptr, 10);
    } else {
      std::ifstream file(argv[i], std::ios::binary);
      const std::vector<char> text{std::istreambuf_iterator<char>(file), {}};
      const std::vector<std::uint8_t> bytes(text.begin(), text.end());
      fuzz::scene = argv[i];
      files = true;
      LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
    }
  }
  if (files) return 0;
  for (long k = 0; k < count; ++k) {
    scene = "--seed " + std::to_string(seed + static_cast<unsigned long>(k)) + " --count 1";
    fuzz::scene = scene.c_str();
    std::mt19937_64 generator(seed + static_cast<unsigned long>(k));
    std::vector<std::uint8_t> bytes(generator() % 1500);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(generator());
    LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  }
  std::printf("%ld inputs, no promise broken\n", count);
  return 0;
}
