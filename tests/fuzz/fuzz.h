// What the fuzz targets share. Each defines LLVMFuzzerTestOneInput; see scripts/fuzz and driver.cpp.
#pragma once

#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace fuzz {

inline std::string_view text_of(const std::uint8_t* data, std::size_t size) {
    return {reinterpret_cast<const char*>(data), size};
}

/// Takes the first `size` bytes, or what there is, from the front.
inline std::string_view take(std::string_view& input, std::size_t size) {
    const auto front = input.substr(0, size);
    input.remove_prefix(front.size());
    return front;
}
inline std::size_t take_number(std::string_view& input, std::size_t bytes) {
    std::size_t number = 0;
    for (const char c : take(input, bytes)) number = number << 8 | static_cast<unsigned char>(c);
    return number;
}

/// A finding, unless `condition`.
inline void require(bool condition, std::string_view what) {
    if (condition) return;
    std::fprintf(stderr, "fuzz: %.*s\n", static_cast<int>(what.size()), what.data());
    std::abort();
}

/// Whatever `read` is given, it must succeed or say in one sentence why it does not. Any other exception than
/// std::runtime_error is a finding.
template <class Read>
bool accepts(const Read& read) {
    try {
        read();
        return true;
    } catch (const std::runtime_error& error) {
        const std::string_view sentence = error.what();
        require(sentence.size() > 10 && sentence.size() < 10'000, "an error without a sentence");
        require(sentence.find('\n') == std::string_view::npos, "an error of several lines");
        return false;
    }
}

/// A folder of this process's own.
class Folder {
  public:
    Folder() : path_(std::filesystem::temp_directory_path() / ("cale-fuzz-" + std::to_string(::getpid()))) {
        std::filesystem::create_directories(path_);
    }
    Folder(const Folder&) = delete;
    Folder& operator=(const Folder&) = delete;
    ~Folder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    std::filesystem::path operator/(std::string_view name) const { return path_ / name; }
    std::filesystem::path write(std::string_view name, std::string_view bytes) const {
        std::ofstream(path_ / name, std::ios::binary) << bytes;
        return path_ / name;
    }

  private:
    std::filesystem::path path_;
};

}  // namespace fuzz
