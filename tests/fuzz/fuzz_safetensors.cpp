// Named tensors.

#include "fuzz.h"
#include "policy/torch/safetensors.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    static const fuzz::Folder folder;
    const auto file = folder.write("input.safetensors", fuzz::text_of(data, size));
    fuzz::accepts([&] {
        std::size_t bytes = 0;
        for (const auto& [name, tensor] : cale::load_safetensors(file).tensors) bytes += tensor.nbytes();
        fuzz::require(bytes <= size, "more tensors than bytes");
    });
    return 0;
}
