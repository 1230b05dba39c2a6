#include "train/agent_file.h"

#include <zstd.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <map>
#include <memory>
#include <stdexcept>
#include <string_view>
#include <vector>

#include <ATen/ATen.h>
#include <fmt/format.h>

#include "storage/files.h"
#include "train/safetensors.h"

namespace cale {
namespace fs = std::filesystem;

namespace {

// Weights hardly become smaller at higher levels, which take several times as long.
constexpr int kCompressionLevel = 1;
constexpr std::uint64_t kMostBytesPerByte = 32'768;  // a block of 128 KiB of one value takes 4 bytes
constexpr std::size_t kSmall = 1024;                 // bytes of a tensor that is not worth a comparison

[[noreturn]] void refuse(const fs::path& file, std::string_view why) {
    throw std::runtime_error(fmt::format("'{}' cannot be used: {}", file.string(), why));
}

// Tensors that have the same contents -------------------------------------------------

bool same_contents(const torch::Tensor& a, const torch::Tensor& b) {
    return a.scalar_type() == b.scalar_type() && a.sizes() == b.sizes() &&
           std::memcmp(a.const_data_ptr(), b.const_data_ptr(), a.nbytes()) == 0;
}

struct Distinct {
    TensorMap tensors;
    std::map<std::string, std::string> same;  // each other name, and the one of `tensors` with its contents
};

Distinct distinct(const TensorMap& state) {
    Distinct result;
    std::multimap<std::size_t, std::string> by_size;  // of what is stored
    for (const auto& [name, given] : state) {
        if (!given.defined() || given.nbytes() < kSmall) {
            result.tensors[name] = given;  // which says what is wrong with it when it is saved
            continue;
        }
        const auto tensor = given.detach().to(at::kCPU).contiguous();
        const auto [begin, end] = by_size.equal_range(tensor.nbytes());
        const auto found = std::find_if(begin, end, [&](const auto& stored) {
            return same_contents(result.tensors.at(stored.second), tensor);
        });
        if (found != end) {
            result.same[name] = found->second;
        } else {
            result.tensors[name] = tensor;
            by_size.emplace(tensor.nbytes(), name);
        }
    }
    return result;
}

/// Adds the tensors that are not stored themselves.
TensorMap expanded(const fs::path& file, SafetensorsFile stored, std::uint64_t most_bytes) {
    TensorMap all = stored.tensors;
    std::uint64_t bytes = 0;
    for (const auto& [name, source] : stored.metadata) {
        const auto found = stored.tensors.find(source);
        if (found == stored.tensors.end() || stored.tensors.contains(name))
            refuse(file, "its metadata name a tensor that is not there, or one that is");
        bytes += found->second.nbytes();
        if (bytes > most_bytes) refuse(file, "its metadata name more tensors than it can hold");
        // A copy, because the caller may write into it.
        all[name] = found->second.clone();
    }
    return all;
}

// Compression -------------------------------------------------------------------------

struct FreeContext {
    void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
};

class Compression {
  public:
    explicit Compression(std::uint64_t bytes) : context_(ZSTD_createCCtx()), chunk_(ZSTD_CStreamOutSize()) {
        ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_compressionLevel, kCompressionLevel);
        ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_checksumFlag, 1);
        ZSTD_CCtx_setPledgedSrcSize(context_.get(), bytes);
    }
    /// `last`: nothing follows.
    void add(std::string_view bytes, bool last = false) {
        ZSTD_inBuffer input{bytes.data(), bytes.size(), 0};
        for (;;) {
            ZSTD_outBuffer output{chunk_.data(), chunk_.size(), 0};
            const auto left =
                ZSTD_compressStream2(context_.get(), &output, &input, last ? ZSTD_e_end : ZSTD_e_continue);
            if (ZSTD_isError(left) != 0)
                throw std::runtime_error(fmt::format("zstd: {}", ZSTD_getErrorName(left)));
            result.append(chunk_.data(), output.pos);
            if (last ? left == 0 : input.pos == input.size) return;
        }
    }

    std::string result;

  private:
    std::unique_ptr<ZSTD_CCtx, FreeContext> context_;
    std::vector<char> chunk_;
};

std::string decompressed(const fs::path& file, std::string_view bytes) {
    const auto size = ZSTD_getFrameContentSize(bytes.data(), bytes.size());
    if (size == ZSTD_CONTENTSIZE_ERROR || size == ZSTD_CONTENTSIZE_UNKNOWN ||
        size > kMostBytesPerByte * bytes.size()) {
        refuse(file, "it does not begin as a file that zstd has compressed");
    }
    std::string contents(size, '\0');
    const auto written = ZSTD_decompress(contents.data(), contents.size(), bytes.data(), bytes.size());
    if (ZSTD_isError(written) != 0)
        refuse(file, fmt::format("it is damaged (zstd: {})", ZSTD_getErrorName(written)));
    contents.resize(written);
    return contents;
}

}  // namespace

void save_agent(const fs::path& folder, const TensorMap& state) {
    const auto file = folder / kAgentFile;
    const auto [tensors, same] = distinct(state);
    const auto [header, stored] = pieces_of(file, tensors, same);
    std::uint64_t bytes = header.size();
    for (const auto& tensor : stored) bytes += tensor.nbytes();
    Compression compression(bytes);
    compression.add(header);
    for (const auto& tensor : stored)
        compression.add({static_cast<const char*>(tensor.const_data_ptr()), tensor.nbytes()});
    compression.add({}, /*last=*/true);
    write_file_atomically(file, compression.result);
}

TensorMap load_agent(const fs::path& folder) {
    const auto file = folder / kAgentFile;
    const auto bytes = read_file(file);
    return expanded(file, parse_safetensors(decompressed(file, bytes), file),
                    kMostBytesPerByte * bytes.size());
}

}  // namespace cale
