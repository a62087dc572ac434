// Writes the EXR files of exr/ with the OpenEXR library (3.1.5):
//   g++ -O1 make_exr.cpp -o make_exr -lOpenEXR -lImath -lIex -I/usr/include/OpenEXR -I/usr/include/Imath
//   ./make_exr exr
// Pictures are 24 x 36, so that every compression has two blocks or more, the last not full.
// R = (x + 1) / 32, G = (y + 1) / 64, B = x * y / 1024, Y = (x + y) / 64, exact as halves.
#include <ImfArray.h>
#include <ImfChannelList.h>
#include <ImfDeepFrameBuffer.h>
#include <ImfDeepScanLineOutputPart.h>
#include <ImfFrameBuffer.h>
#include <ImfMultiPartOutputFile.h>
#include <ImfOutputFile.h>
#include <ImfOutputPart.h>
#include <ImfPartType.h>
#include <ImfRgbaFile.h>
#include <ImfStandardAttributes.h>
#include <ImfTiledOutputFile.h>
#include <cmath>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

using namespace Imf;
using namespace Imath;

const int W = 24, H = 36;

double value(const std::string& channel, int x, int y) {
  const std::string base = channel.substr(channel.rfind('.') + 1);
  if (base == "R") return (x + 1) / 32.0;
  if (base == "G") return (y + 1) / 64.0;
  if (base == "B") return x * y / 1024.0;
  if (base == "Y") return (x + y) / 64.0;
  return 0.75;  // anything else: alpha, depth
}

// One plane of samples of any type.
struct Plane {
  PixelType type;
  std::vector<half> halves;
  std::vector<float> floats;
  std::vector<unsigned> counts;

  Plane(const std::string& name, PixelType type, double scale = 1) : type(type) {
    for (int y = 0; y < H; ++y)
      for (int x = 0; x < W; ++x) {
        const double v = value(name, x, y) * scale;
        halves.push_back(half(float(v)));
        floats.push_back(float(v));
        // Light of 0 or 1: a checkerboard whose squares differ by channel.
        const int step = name == "R" ? 1 : name == "G" ? 2 : 4;
        counts.push_back((x / step + y / step) % 2);
      }
  }

  Slice slice(V2i origin = V2i(0, 0)) {
    const size_t size = type == HALF ? 2 : 4;
    char* base = type == HALF    ? (char*)halves.data()
                 : type == FLOAT ? (char*)floats.data()
                                 : (char*)counts.data();
    return Slice(type, base - (origin.x + origin.y * W) * long(size), size, size * W);
  }
};

struct Picture {
  std::vector<std::string> names;
  std::vector<Plane> planes;

  Picture(std::vector<std::pair<std::string, PixelType>> channels, double scale = 1) {
    for (auto& [name, type] : channels) {
      names.push_back(name);
      planes.emplace_back(name, type, scale);
    }
  }

  void describe(Header& header) {
    for (size_t i = 0; i < names.size(); ++i)
      header.channels().insert(names[i], Channel(planes[i].type));
  }

  FrameBuffer buffer(V2i origin = V2i(0, 0)) {
    FrameBuffer buffer;
    for (size_t i = 0; i < names.size(); ++i) buffer.insert(names[i], planes[i].slice(origin));
    return buffer;
  }
};

Picture rgb(PixelType type) { return Picture({{"R", type}, {"G", type}, {"B", type}}); }

void scanlines(const std::string& path, Picture picture, Compression compression,
               LineOrder order = INCREASING_Y, V2i origin = V2i(0, 0)) {
  Box2i window(origin, origin + V2i(W - 1, H - 1));
  Header header(window, window);
  header.compression() = compression;
  header.lineOrder() = order;
  picture.describe(header);
  OutputFile file(path.c_str(), header);
  file.setFrameBuffer(picture.buffer(origin));
  // Decreasing files are written from the bottom, so one call serves both.
  file.writePixels(H);
}

void tiles(const std::string& path, LevelMode mode, Compression compression) {
  Picture picture({{"R", HALF}, {"G", FLOAT}, {"B", HALF}, {"A", HALF}});
  Header header(W, H);
  header.compression() = compression;
  header.setTileDescription(TileDescription(10, 7, mode));
  picture.describe(header);
  TiledOutputFile file(path.c_str(), header);
  file.setFrameBuffer(picture.buffer());
  for (int ly = 0; ly < file.numYLevels(); ++ly)
    for (int lx = 0; lx < file.numXLevels(); ++lx)
      if (file.isValidLevel(lx, ly))
        file.writeTiles(0, file.numXTiles(lx) - 1, 0, file.numYTiles(ly) - 1, lx, ly);
}

void parts(const std::string& path) {
  Picture depth({{"Z", FLOAT}}), beauty = rgb(HALF), grey({{"Y", HALF}});
  const char* names[] = {"depth", "beauty", "grey"};
  Picture* pictures[] = {&depth, &beauty, &grey};
  std::vector<Header> headers;
  for (int i = 0; i < 3; ++i) {
    Header header(W, H);
    header.setName(names[i]);
    header.setType(SCANLINEIMAGE);
    header.compression() = i == 1 ? PIZ_COMPRESSION : ZIP_COMPRESSION;
    pictures[i]->describe(header);
    headers.push_back(header);
  }
  MultiPartOutputFile file(path.c_str(), headers.data(), 3);
  for (int i = 0; i < 3; ++i) {
    OutputPart part(file, i);
    part.setFrameBuffer(pictures[i]->buffer());
    part.writePixels(H);
  }
}

// A flat part behind a deep one.
void deep(const std::string& path) {
  Picture flat = rgb(HALF);
  std::vector<Header> headers;
  Header deep_header(W, H), flat_header(W, H);
  deep_header.setName("deep");
  deep_header.setType(DEEPSCANLINE);
  deep_header.compression() = ZIPS_COMPRESSION;
  deep_header.channels().insert("Z", Channel(FLOAT));
  flat_header.setName("flat");
  flat_header.setType(SCANLINEIMAGE);
  flat.describe(flat_header);
  headers.push_back(deep_header);
  headers.push_back(flat_header);
  MultiPartOutputFile file(path.c_str(), headers.data(), 2);

  Array2D<unsigned> counts(H, W);
  Array2D<float*> samples(H, W);
  std::vector<float> one(1, 1.5f);
  for (int y = 0; y < H; ++y)
    for (int x = 0; x < W; ++x) {
      counts[y][x] = (x + y) % 2;
      samples[y][x] = one.data();
    }
  DeepFrameBuffer buffer;
  buffer.insertSampleCountSlice(Slice(UINT, (char*)&counts[0][0], 4, 4 * W));
  buffer.insert("Z", DeepSlice(FLOAT, (char*)&samples[0][0], sizeof(float*), sizeof(float*) * W, 4));
  DeepScanLineOutputPart part(file, 0);
  part.setFrameBuffer(buffer);
  part.writePixels(H);

  OutputPart flat_part(file, 1);
  flat_part.setFrameBuffer(flat.buffer());
  flat_part.writePixels(H);
}

// What OpenEXR's own reader makes of a file, as floats.
void reference(const std::string& path) {
  RgbaInputFile file(path.c_str());
  std::vector<Rgba> read(W * H);
  file.setFrameBuffer(read.data(), 1, W);
  file.readPixels(0, H - 1);
  std::ofstream out(path.substr(0, path.size() - 3) + "f32", std::ios::binary);
  for (const Rgba& pixel : read)
    for (float v : {float(pixel.r), float(pixel.g), float(pixel.b)}) out.write((char*)&v, 4);
}

// Luminance and chroma by OpenEXR's own filter.
void luminance_chroma(const std::string& path, Compression compression, bool wide_gamut) {
  Header header(W, H);
  header.compression() = compression;
  if (wide_gamut)
    addChromaticities(header, Chromaticities(V2f(.708f, .292f), V2f(.170f, .797f),
                                             V2f(.131f, .046f), V2f(.3127f, .3290f)));
  std::vector<Rgba> pixels;
  for (int y = 0; y < H; ++y)
    for (int x = 0; x < W; ++x) {
      Rgba pixel(value("R", x, y), value("G", x, y), value("B", x, y));
      // An edge, a grey block and a saturated dot, which the chroma filter smears.
      if (x >= 12 && y >= 20) pixel = Rgba(.5f, .5f, .5f);
      if (x == 5 && y == 5) pixel = Rgba(.9f, .01f, .01f);
      pixels.push_back(pixel);
    }
  RgbaOutputFile file(path.c_str(), header, WRITE_YC);
  file.setFrameBuffer(pixels.data(), 1, W);
  file.writePixels(H);
}

// NaN, both infinities, negative light and highlights, one of each per pixel of the first row.
void hard_light(const std::string& path, PixelType type) {
  Picture picture = rgb(type);
  const float inf = std::numeric_limits<float>::infinity();
  const float values[] = {NAN, inf, -inf, -0.25f, 1e6f, 6e4f, 0.f, -0.f};
  for (Plane& plane : picture.planes)
    for (int x = 0; x < 8; ++x) {
      plane.floats[x] = values[x];
      plane.halves[x] = half(values[x]);
    }
  scanlines(path, picture, ZIP_COMPRESSION);
}

int main(int, char** argv) {
  const std::string to = std::string(argv[1]) + "/";
  const std::pair<const char*, Compression> all[] = {
      {"none", NO_COMPRESSION}, {"rle", RLE_COMPRESSION},     {"zips", ZIPS_COMPRESSION},
      {"zip", ZIP_COMPRESSION}, {"piz", PIZ_COMPRESSION},     {"pxr24", PXR24_COMPRESSION},
      {"b44", B44_COMPRESSION}, {"dwaa", DWAA_COMPRESSION}};
  for (auto& [name, compression] : all) {
    scanlines(to + "half-" + name + ".exr", rgb(HALF), compression);
    if (compression < B44_COMPRESSION) {
      scanlines(to + "float-" + name + ".exr", rgb(FLOAT), compression);
      luminance_chroma(to + "yc-" + name + ".exr", compression, false);
    }
  }
  reference(to + "half-b44.exr");
  reference(to + "half-dwaa.exr");
  reference(to + "yc-zip.exr");
  luminance_chroma(to + "yc-b44.exr", B44_COMPRESSION, false);
  luminance_chroma(to + "yc-rec2020.exr", ZIP_COMPRESSION, true);
  reference(to + "yc-rec2020.exr");
  scanlines(to + "uint.exr", rgb(UINT), ZIP_COMPRESSION);
  scanlines(to + "uint-pxr24.exr", rgb(UINT), PXR24_COMPRESSION);
  scanlines(to + "mixed.exr", Picture({{"R", FLOAT}, {"G", HALF}, {"B", FLOAT}, {"A", HALF}, {"Z", UINT}}),
            ZIP_COMPRESSION);
  scanlines(to + "decreasing.exr", rgb(HALF), ZIPS_COMPRESSION, DECREASING_Y);
  scanlines(to + "offset.exr", rgb(HALF), ZIPS_COMPRESSION, INCREASING_Y, V2i(-7, 1000));
  scanlines(to + "grey.exr", Picture({{"Y", HALF}, {"A", HALF}}), ZIP_COMPRESSION);
  scanlines(to + "layer.exr", Picture({{"left.R", HALF}, {"left.G", HALF}, {"left.B", HALF}}), ZIP_COMPRESSION);
  scanlines(to + "layers.exr",
            Picture({{"left.R", HALF}, {"left.G", HALF}, {"left.B", HALF}, {"right.Y", HALF}}), ZIP_COMPRESSION);
  scanlines(to + "no-blue.exr", Picture({{"R", HALF}, {"G", HALF}}), ZIP_COMPRESSION);
  tiles(to + "tiled.exr", ONE_LEVEL, ZIP_COMPRESSION);
  tiles(to + "mipmap.exr", MIPMAP_LEVELS, PIZ_COMPRESSION);
  tiles(to + "ripmap.exr", RIPMAP_LEVELS, RLE_COMPRESSION);
  parts(to + "parts.exr");
  deep(to + "deep-and-flat.exr");
  hard_light(to + "hard-half.exr", HALF);
  hard_light(to + "hard-float.exr", FLOAT);
}
