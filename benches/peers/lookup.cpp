// Trilinear look-ups by OpenVDB and NanoVDB: the other side of `cargo bench --bench lookup`.
//
// lookup FILE GRID ROUNDS POINTS...   one thread; POINTS are raw 64-bit x, y, z in index space.
// For each file of points and each library prints: library, best seconds of the rounds, sum.
//
// OpenVDB: a ConstAccessor and BoxSampler. NanoVDB: a ReadAccessor of all levels and its
// trilinear sampler, which keeps the last cell's corners; from the same values in 32 bits.

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include <nanovdb/util/OpenToNanoVDB.h>
#include <nanovdb/util/SampleFromVoxels.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>

namespace {

std::vector<double> read_points(const char* path) {
    std::ifstream in(path, std::ios::binary | std::ios::ate);
    if (!in) {
        std::fprintf(stderr, "%s: cannot be read\n", path);
        std::exit(1);
    }
    std::vector<double> points(static_cast<size_t>(in.tellg()) / sizeof(double));
    in.seekg(0);
    in.read(reinterpret_cast<char*>(points.data()), points.size() * sizeof(double));
    return points;
}

void report(const char* library, int rounds, const std::function<double()>& run) {
    double best = std::numeric_limits<double>::infinity(), sum = 0.0;
    for (int round = 0; round < rounds; ++round) {
        const auto start = std::chrono::steady_clock::now();
        sum = run();
        const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
        best = std::min(best, taken.count());
    }
    std::printf("%s %.9g %.17g\n", library, best, sum);
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 5) {
        std::fprintf(stderr, "lookup FILE GRID ROUNDS POINTS...\n");
        return 2;
    }
    openvdb::initialize();
    openvdb::io::File file(argv[1]);
    file.open(false);
    const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(file.readGrid(argv[2]));
    const auto handle = nanovdb::openToNanoVDB(grid);
    const auto* nano = handle.grid<float>();
    const int rounds = std::atoi(argv[3]);
    for (int i = 4; i < argc; ++i) {
        const std::vector<double> points = read_points(argv[i]);
        std::vector<nanovdb::Vec3f> singles;
        for (size_t p = 0; p + 2 < points.size(); p += 3) {
            singles.emplace_back(float(points[p]), float(points[p + 1]), float(points[p + 2]));
        }
        report("OpenVDB", rounds, [&] {
            auto accessor = grid->getConstAccessor();
            double sum = 0.0;
            for (size_t p = 0; p + 2 < points.size(); p += 3) {
                const openvdb::Vec3R at(points[p], points[p + 1], points[p + 2]);
                sum += openvdb::tools::BoxSampler::sample(accessor, at);
            }
            return sum;
        });
        report("NanoVDB", rounds, [&] {
            auto accessor = nano->getAccessor();
            auto sampler = nanovdb::createSampler<1>(accessor);
            double sum = 0.0;
            for (const auto& at : singles) {
                sum += sampler(at);
            }
            return sum;
        });
    }
    return 0;
}
