// Feeds a fuzz target without libFuzzer, so that every compiler can: the files of a corpus, then mutations of
// them, the same ones every time:   fuzz_NAME CORPUS [MUTATIONS [SEED]]
#include <algorithm>
#include <array>
#include <filesystem>
#include <iterator>
#include <new>
#include <random>
#include <vector>

#include "fuzz.h"

namespace {

/// No input of these sizes needs more at once.
constexpr std::size_t kLargestAllocation = std::size_t{64} << 20;
constexpr std::size_t kLargestInput = 64 << 10;

using Random = std::mt19937_64;

std::size_t below(std::size_t end, Random& random) {
    return static_cast<std::size_t>(random() % end);
}

void mutate(std::string& input, const std::vector<std::string>& corpus, Random& random) {
    constexpr std::array<std::string_view, 16> pieces{std::string_view("\0\0\0\0\0\0\0\0", 8),
                                                      "\xff\xff\xff\xff\xff\xff\xff\xff",
                                                      "\x7f",
                                                      "\x80",
                                                      "-1",
                                                      "1e999",
                                                      "18446744073709551616",
                                                      "nan",
                                                      "null",
                                                      "[[[[[[[[",
                                                      "{\"\":",
                                                      "\xc3\x28",
                                                      "\n",
                                                      ": ",
                                                      ",",
                                                      "../"};
    const std::size_t place = below(input.size() + 1, random);
    const std::size_t length = below(std::min<std::size_t>(input.size() - place, 64) + 1, random);
    switch (below(8, random)) {
        case 0:
            if (place < input.size())
                input[place] = static_cast<char>(input[place] ^ (1 << below(8, random)));
            break;
        case 1:
            if (place < input.size()) input[place] = static_cast<char>(random());
            break;
        case 2:
            input.insert(place, 1 + below(4, random), static_cast<char>(random()));
            break;
        case 3:
            input.erase(place, length);
            break;
        case 4:
            input.insert(below(input.size() + 1, random), input.substr(place, length));
            break;
        case 5:
            input.insert(place, pieces[below(pieces.size(), random)]);
            break;
        case 6:
            input.resize(place);
            break;
        default: {
            const auto& other = corpus[below(corpus.size(), random)];
            input = input.substr(0, place) + other.substr(below(other.size() + 1, random));
        }
    }
    if (input.size() > kLargestInput) input.resize(kLargestInput);
}

void feed(const std::string& input) {
    LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(input.data()), input.size());
}

}  // namespace

void* operator new(std::size_t size) {
    fuzz::require(size <= kLargestAllocation, "an allocation that no input warrants");
    if (void* memory = std::malloc(size)) return memory;
    throw std::bad_alloc();
}
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
    fuzz::require(size <= kLargestAllocation, "an allocation that no input warrants");
    return std::malloc(size);
}
void operator delete(void* memory) noexcept {
    std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
    std::free(memory);
}

int main(int argc, char** argv) {
    if (argc < 2 || argc > 4) {
        std::fprintf(stderr, "usage: %s CORPUS [MUTATIONS [SEED]]\n", argv[0]);
        return 2;
    }
    std::vector<std::filesystem::path> files;
    for (const auto& entry : std::filesystem::directory_iterator(argv[1])) files.push_back(entry.path());
    std::ranges::sort(files);
    std::vector<std::string> corpus{""};
    for (const auto& path : files) {
        std::ifstream file(path, std::ios::binary);
        corpus.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
    }
    for (const auto& input : corpus) feed(input);
    Random random(argc > 3 ? std::strtoull(argv[3], nullptr, 10) : 1);
    const long mutations = argc > 2 ? std::atol(argv[2]) : 0;
    for (long i = 0; i < mutations; ++i) {
        std::string input = corpus[below(corpus.size(), random)];
        for (std::size_t times = 1 + below(6, random); times > 0; --times) mutate(input, corpus, random);
        feed(input);
    }
    std::printf("%zu inputs and %ld mutations: nothing found\n", corpus.size(), mutations);
}
