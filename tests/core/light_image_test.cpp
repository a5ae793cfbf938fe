// Images on lights: where they show what, and that samples follow their brightness.
#include "core/shade/light_image.h"

#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>

#include "core/shade/lights.h"
#include "light_kinds.h"

namespace encore {
namespace {

const Vec3f kX{1, 0, 0}, kY{0, 1, 0}, kZ{0, 0, 1};

void expectPoint(DomeFormat format, Vec3f d, float s, float t) {
  const Vec2f p = domeImagePoint(format, normalize(d));
  EXPECT_NEAR(p.x, s, 1e-3) << int(format);
  EXPECT_NEAR(p.y, t, 1e-3) << int(format);
}

TEST(DomeFormats, ShowDirectionsWhereTheyShould) {
  expectPoint(DomeFormat::LatLong, kZ, 0.5f, 0.5f);
  expectPoint(DomeFormat::LatLong, -kX, 0.75f, 0.5f);
  expectPoint(DomeFormat::LatLong, kX, 0.25f, 0.5f);
  expectPoint(DomeFormat::LatLong, {1e-4f, 0, -1}, 0, 0.5f);
  expectPoint(DomeFormat::LatLong, {0, 1, 1}, 0.5f, 0.75f);
  EXPECT_NEAR(domeImagePoint(DomeFormat::LatLong, kY).y, 1, 1e-6);
  expectPoint(DomeFormat::MirroredBall, kZ, 0.5f, 0.5f);
  expectPoint(DomeFormat::MirroredBall, kX, 0.5f + 0.5f * std::sqrt(0.5f), 0.5f);
  expectPoint(DomeFormat::MirroredBall, kY, 0.5f, 0.5f + 0.5f * std::sqrt(0.5f));
  expectPoint(DomeFormat::Angular, kZ, 0.5f, 0.5f);
  expectPoint(DomeFormat::Angular, kX, 0.75f, 0.5f);
  expectPoint(DomeFormat::Angular, -kY, 0.5f, 0.25f);
  expectPoint(DomeFormat::Angular, {1e-4f, 0, -1}, 1, 0.5f);
  const float third = 1.0f / 3;
  expectPoint(DomeFormat::CubeMapVerticalCross, kZ, 0.5f, 0.625f);
  expectPoint(DomeFormat::CubeMapVerticalCross, kX, 0.5f * third, 0.625f);
  expectPoint(DomeFormat::CubeMapVerticalCross, -kX, 2.5f * third, 0.625f);
  expectPoint(DomeFormat::CubeMapVerticalCross, kY, 0.5f, 0.875f);
  expectPoint(DomeFormat::CubeMapVerticalCross, -kY, 0.5f, 0.375f);
  expectPoint(DomeFormat::CubeMapVerticalCross, -kZ, 0.5f, 0.125f);
  // Neighbours in the cross share edges: a step across one is a small step in the image.
  for (const Vec3f edge :
       {Vec3f{1, 0.3f, 1}, Vec3f{-1, 0.3f, 1}, Vec3f{0.3f, 1, 1}, Vec3f{0.3f, -1, 1}, Vec3f{0.3f, -1, -1}}) {
    const Vec2f a = domeImagePoint(DomeFormat::CubeMapVerticalCross, normalize(edge + Vec3f{0, 0, 1e-3f}));
    const Vec2f b = domeImagePoint(DomeFormat::CubeMapVerticalCross, normalize(edge - Vec3f{0, 0, 1e-3f}));
    EXPECT_LT(std::abs(a.x - b.x) + std::abs(a.y - b.y), 2e-3f);
  }
}

// What an environment looks like in a format, by trying directions for every pixel: the inverse that nobody wrote.
Texture pictureOf(DomeFormat format, uint32_t width, uint32_t height, Vec3f (*look)(Vec3f)) {
  Texture t{"sky", width, height, std::vector<float>(size_t(width) * height * 4, 0.0f), nullptr};
  std::vector<float> best(size_t(width) * height, 1e9f);
  constexpr uint32_t kDirections = 1 << 18;
  for (uint32_t i = 0; i < kDirections; ++i) {
    const Vec3f d = test::onSphere(sobol2(i, 1));
    const Vec2f st = domeImagePoint(format, d);
    const float x = st.x * float(width), y = st.y * float(height);
    const uint32_t px = std::min(uint32_t(x), width - 1), py = std::min(uint32_t(y), height - 1);
    const float off = std::abs(x - float(px) - 0.5f) + std::abs(y - float(py) - 0.5f);
    float& least = best[size_t(py) * width + px];
    if (off >= least) continue;
    least = off;
    const Vec3f c = look(d);
    for (int k = 0; k < 3; ++k) t.rgba[(size_t(py) * width + px) * 4 + size_t(k)] = c[k];
  }
  return t;
}
Vec3f smoothSky(Vec3f d) { return {1 + d.x, 1 + d.y, 1 + d.z}; }

TEST(DomeFormats, AllShowTheSameSky) {
  const struct {
    DomeFormat format;
    uint32_t width, height;
  } cases[] = {{DomeFormat::LatLong, 128, 64},
               {DomeFormat::MirroredBall, 128, 128},
               {DomeFormat::Angular, 128, 128},
               {DomeFormat::CubeMapVerticalCross, 96, 128}};
  for (const auto& c : cases) {
    const LightImage image(pictureOf(c.format, c.width, c.height, smoothSky), c.format);
    double sum = 0;
    for (uint32_t i = 0; i < 2000; ++i) {
      const Vec3f d = test::onSphere(sobol2(i, 9));
      // The rim of a ball holds the directions away from it in hardly any pixels.
      const bool rim = c.format != DomeFormat::LatLong && d.z < -0.9f && c.format != DomeFormat::CubeMapVerticalCross;
      const float off = maxComponent(absolute(image.towards(d) - smoothSky(d)));
      EXPECT_LT(off, rim ? 3 : 0.12f) << int(c.format) << " " << d.x << " " << d.y << " " << d.z;
      sum += double(off);
    }
    EXPECT_LT(sum / 2000, 0.03) << int(c.format);
    EXPECT_LT(maxComponent(absolute(image.average() - Vec3f{1, 1, 1})), 0.02f) << int(c.format);
  }
}

Texture randomSky(uint32_t width, uint32_t height) {
  Texture t{"sky", width, height, {}, nullptr};
  for (uint32_t i = 0; i < width * height; ++i) {
    const auto h = pcg4d(i, 4, 4, 4);
    const float bright = i % 97 == 5 ? 300.0f : i / width < height / 4 ? 0.0f : 1.0f;  // suns, and a black ground
    for (int k = 0; k < 3; ++k) t.rgba.push_back(bright * toUnit(h[size_t(k)]));
    t.rgba.push_back(1);
  }
  return t;
}

TEST(LightImage, SamplesFollowTheDensity) {
  const LightImage image(randomSky(32, 16), DomeFormat::LatLong);
  const auto sample = [&](Vec2f u, Vec3f& d) { return d = image.sample(u), true; };
  const test::ChiSquared chi = test::testDirections(sample, [&](Vec3f d) { return image.pdf(d); });
  EXPECT_GT(chi.cells, 200);
  EXPECT_LT(chi.value(), chi.limit());
  // Wherever something is to be seen, samples may go.
  for (uint32_t i = 0; i < 20000; ++i) {
    const Vec3f d = test::onSphere(sobol2(i, 2));
    ASSERT_TRUE(image.pdf(d) > 0 || maxComponent(image.towards(d)) <= 1e-6f) << i;
  }
}

Light texturedDome() {
  Light light;
  light.kind = Light::Kind::Dome;
  light.axis_x = {0, 1, 0}, light.axis_y = {0, 0, 1}, light.axis_z = {1, 0, 0};
  return light;
}

TEST(LightImage, DomesAreSampledByBrightnessAndCosine) {
  const LightImage image(randomSky(32, 16), DomeFormat::LatLong);
  const Light light = texturedDome();
  const LightParts parts{&image, nullptr, nullptr, 0};
  const LightSampler sampler(light, {0, 0, 0}, normalize(Vec3f{1, 1, 3}), parts);
  const auto sample = [&](Vec2f u, Vec3f& d) {
    const LightSample s = sampler.sample(u);
    d = s.direction;
    return s.valid;
  };
  const test::ChiSquared chi = test::testDirections(sample, [&](Vec3f d) { return sampler.pdf(d); });
  EXPECT_GT(chi.cells, 200);
  EXPECT_LT(chi.value(), chi.limit());
  // Axes turn the image: its top is the dome's Y.
  const Vec3f up = lightRadiance(light, &image, {1e30f, {}}, {0, 0, 1});
  EXPECT_EQ(up, image.towards({0, 1, 0}));
}

// A small sun in a dim sky: brightness finds it, the cosine alone would not.
TEST(LightImage, AFewSamplesFindASmallSun) {
  Texture sky{"sun", 256, 128, std::vector<float>(256 * 128 * 4, 0.1f), nullptr};
  for (int k = 0; k < 4; ++k) sky.rgba[(96 * 256 + 30) * 4 + size_t(k)] = 1e4f;
  const LightImage image(sky, DomeFormat::LatLong);
  Light light = texturedDome();
  const Vec3f n{0, 0, 1};
  double exact = 0;
  for (uint32_t i = 0; i < 1 << 20; ++i) {
    const Vec3f d = test::onSphere(sobol2(i, 3));
    exact += double(lightRadiance(light, &image, {1e30f, {}}, d).x * std::max(d.z, 0.0f)) * 4 * 3.14159265 / (1 << 20);
  }
  const LightParts parts{&image, nullptr, nullptr, 0};
  const LightSampler sampler(light, {0, 0, 0}, n, parts);
  double mean = 0;
  for (uint32_t seed = 0; seed < 200; ++seed) {
    double sum = 0;
    for (uint32_t i = 0; i < 64; ++i) {
      const LightSample s = sampler.sample(sobol2(i, seed));
      sum += double(s.radiance.x * std::max(dot(s.direction, n), 0.0f) / s.pdf) / 64;
    }
    EXPECT_NEAR(sum / exact, 1, 0.6) << seed;
    mean += sum / 200;
  }
  EXPECT_NEAR(mean / exact, 1, 0.02);
}

TEST(LightImage, RectanglesShowTheirImageUpright) {
  Texture picture{"four", 2, 2, {1, 0, 0, 1, 0, 1, 0, 1, 0, 0, 1, 1, 1, 1, 1, 1}, nullptr};  // r g below b w
  const LightImage image(picture);
  EXPECT_EQ(image.at(0, 0), (Vec3f{1, 0, 0}));
  EXPECT_EQ(image.at(1, 0), (Vec3f{0, 1, 0}));
  EXPECT_EQ(image.at(0, 1), (Vec3f{0, 0, 1}));
  EXPECT_EQ(image.at(1, 1), (Vec3f{1, 1, 1}));
  EXPECT_EQ(image.at(0.5f, 0.5f), (Vec3f{0.5f, 0.5f, 0.5f}));
  EXPECT_EQ(image.average(), (Vec3f{0.5f, 0.5f, 0.5f}));
  // half_u along X, emitting down -Z: who looks at it from below with Y up sees +X on the left.
  for (const bool sheared : {false, true}) {
    const Light light = test::light(Light::Kind::Rect, {0.3, 0, 1}, {1, 0, 0}, {sheared ? 0.2f : 0.0f, 1, 0});
    const LightParts parts{&image, nullptr, nullptr, 0};
    const LightSampler sampler(light, {0, 0, 0}, {0, 0, 1}, parts);
    int red = 0;
    for (uint32_t i = 0; i < 500; ++i) {
      const LightSample s = sampler.sample(sobol2(i, 3));
      const Vec3f q = s.direction * s.distance - Vec3f{0.3f, 0, 1};
      const float u = q.x - (sheared ? 0.2f * q.y : 0);
      const Vec3f seen = lightRadiance(light, &image, meetLight(light, {0, 0, 0}, s.direction), s.direction);
      EXPECT_LT(maxComponent(absolute(seen - s.radiance)), 1e-3f);
      if (!(u > 0.6f && q.y < -0.6f)) continue;
      EXPECT_EQ(s.radiance, (Vec3f{1, 0, 0}));
      ++red;
    }
    EXPECT_GT(red, 5);
  }
}

class Halves : public TextureSource {
 public:
  void read(std::span<uint16_t> rgba) const override {
    const uint16_t values[] = {0x3c00, 0x3800, 0x0001, 0x3c00,   // 1, 0.5, the smallest
                               0x7e00, 0xfc00, 0xbc00, 0x3c00};  // not a number, -infinity, -1
    std::copy(std::begin(values), std::end(values), rgba.begin());
  }
};

TEST(LightImage, ReadsSourcesAndDropsWhatIsNoLight) {
  const Texture texture{"halves", 2, 1, {}, std::make_shared<Halves>()};
  const LightImage image(texture);
  EXPECT_EQ(image.at(0, 0.5f), (Vec3f{1, 0.5f, 0x1p-24f}));
  EXPECT_EQ(image.at(1, 0.5f), (Vec3f{0, 0, 0}));
  EXPECT_GE(image.bytes(), 24u);
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  for (const DomeFormat format : {DomeFormat::LatLong, DomeFormat::MirroredBall, DomeFormat::CubeMapVerticalCross}) {
    const LightImage dark({"nan", 1, 1, {nan, -inf, -1, 1}, nullptr}, format);
    EXPECT_TRUE(dark.black());
    EXPECT_EQ(dark.towards(kY), (Vec3f{}));
    EXPECT_EQ(dark.pdf(kY), 0);
    const LightImage one({"one", 1, 1, {2, 2, 2, 1}, nullptr}, format);
    EXPECT_LT(maxComponent(absolute(one.towards(kX) - Vec3f{2, 2, 2})), 1e-5f) << int(format);
    EXPECT_NEAR(length(one.sample({0.3f, 0.7f})), 1, 1e-5);
  }
  const LightImage empty({"gone", 0, 0, {}, nullptr}, DomeFormat::LatLong);
  EXPECT_TRUE(empty.black());
  EXPECT_EQ(empty.towards(kY), (Vec3f{}));
  // A black dome casts no light and is nobody's density.
  const LightImage black({"black", 2, 1, std::vector<float>(8, 0.0f), nullptr}, DomeFormat::LatLong);
  Light light = texturedDome();
  const LightParts parts{&black, nullptr, nullptr, 0};
  EXPECT_FALSE(LightSampler(light, {}, kZ, parts).sample({0.5f, 0.5f}).valid);
}

}  // namespace
}  // namespace encore
