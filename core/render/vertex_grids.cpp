#include "core/render/vertex_grids.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "core/dice/spheres.h"
#include "core/scene/error.h"
#include "core/scene/random.h"

namespace encore {
namespace {

// A face is halved no further than to this share of its domain, per direction: (u, v) stay exact.
constexpr float kLeastSize = 0x1p-18f;
// What is seen edge on counts as this share of its length seen face on: mirrors may show it from elsewhere.
constexpr float kLeastForeshortening = 1.0f / 32;
// A micropolygon is no longer than this, in sides of the square that it should cover.
constexpr float kLongest = 4;

// A 3 × 3 net of points of a rectangle in (u, v), as the camera sees it. halved: only the half below the diagonal,
// on which the middle lines end.
class Net {
 public:
  using Points = std::array<std::array<Vec3f, 3>, 3>;  // relative to the camera; [row along v][column along u]

  Net(const Points& points, bool halved) : points_(points), halved_(halved) {
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 3; ++column) directions_[row][column] = normalize(points[row][column]);
  }

  // Longest lines along u and v, in radians.
  float longestU() const {
    float longest = 0;
    for (int row = 0; row < 3; ++row) longest = std::max(longest, line(row, 0, 0, 1));
    return longest;
  }
  float longestV() const {
    float longest = 0;
    for (int column = 0; column < 3; ++column) longest = std::max(longest, line(0, column, 1, 0));
    return longest;
  }
  // Four times that of the largest quarter, in steradians: what the whole would have if all were like it.
  float area() const {
    float largest = 0;
    for (int row = 0; row < 2; ++row)
      for (int column = 0; column < 2; ++column) largest = std::max(largest, quarter(row, column));
    return 4 * largest;
  }

 private:
  bool exists(int row, int column) const { return !halved_ || row + column <= 2; }

  float span(int row, int column, int down, int across) const {
    const Vec3f a = points_[row][column], b = points_[row + down][column + across];
    const float distance = std::max(length(a), length(b));
    if (!(distance > 0)) return 0;
    const float seen = length(directions_[row][column] - directions_[row + down][column + across]);
    return std::max(seen, length(a - b) / distance * kLeastForeshortening);
  }
  // Two spans, or twice the first where the second is beyond the diagonal.
  float line(int row, int column, int down, int across) const {
    if (!exists(row + down, column + across)) return 0;
    const float first = span(row, column, down, across);
    if (!exists(row + 2 * down, column + 2 * across)) return 2 * first;
    return first + span(row + down, column + across, down, across);
  }
  float quarter(int row, int column) const {
    const Vec3f d00 = directions_[row][column], d01 = directions_[row][column + 1], d10 = directions_[row + 1][column],
                d11 = directions_[row + 1][column + 1];
    if (exists(row + 1, column + 1)) return 0.5f * length(cross(d11 - d00, d10 - d01));
    return exists(row, column + 1) && exists(row + 1, column) ? length(cross(d01 - d00, d10 - d00)) : 0;
  }

  const Points& points_;
  Points directions_;
  bool halved_;
};

uint32_t segments(float length) {  // NaN counts as 0
  return length > 1 ? uint32_t(std::min(std::round(length), 1e6f)) : 1;
}

}  // namespace

bool operator<(const TileRequest& a, const TileRequest& b) {
  const auto order = [](const TileRequest& r) {
    const SurfaceKey key = r.face->key();
    return std::make_tuple(key.instance, key.primitive_side, r.face->level(), r.grid->origin.y, r.grid->origin.x,
                           r.tile);
  };
  return order(a) < order(b);
}

bool GridCell::needs(int corner) const {
  const bool u = corner & 1, v = corner & 2;
  return !(u && fu == 0) && !(v && fv == 0) && !(u && v && halved());
}

VertexTile& GridCell::tile(int corner) const {
  const uint32_t x = i + uint32_t(corner & 1), y = j + uint32_t(corner >> 1);
  return grid->tiles[y / kTileSide * grid->tilesAcross() + x / kTileSide];
}

uint32_t GridCell::slot(int corner) const {
  const uint32_t x = i + uint32_t(corner & 1), y = j + uint32_t(corner >> 1);
  return y % kTileSide * kTileSide + x % kTileSide;
}

void GridCell::request(uint32_t value, std::vector<TileRequest>& requests) const {
  const uint8_t bit = uint8_t(1u << value);
  for (int corner = 0; corner < 4; ++corner) {
    if (!needs(corner)) continue;
    VertexTile& t = tile(corner);
    if (t.requested.load(std::memory_order_relaxed) & bit) continue;
    if (t.requested.fetch_or(bit, std::memory_order_relaxed) & bit) continue;
    requests.push_back({face, grid, uint32_t(&t - grid->tiles.get())});
  }
}

void GridCell::markShadedFor(Layer layer) const {
  const uint8_t bit = uint8_t(1u << uint32_t(layer));
  for (int corner = 0; corner < 4; ++corner) {
    if (!needs(corner)) continue;
    VertexTile& t = tile(corner);
    if (!(t.shaded_for.load(std::memory_order_relaxed) & bit)) t.shaded_for.fetch_or(bit, std::memory_order_relaxed);
  }
}

Vec3f GridCell::interpolate(uint32_t value) const {
  Vec3f corners[4];
  bool known[4];
  int some = -1;
  for (int corner = 0; corner < 4; ++corner) {
    known[corner] = false;
    if (!needs(corner)) continue;
    const VertexTile& t = tile(corner);
    known[corner] = t.used >> slot(corner) & 1;
    if (!known[corner]) continue;
    corners[corner] = (*t.values[value])[slot(corner)];
    if (some < 0) some = corner;
  }
  if (some < 0) return {};
  // Only corners without a weight, and those that rounding has put beyond the face.
  for (int corner = 0; corner < 4; ++corner)
    if (!known[corner]) corners[corner] = corners[some];
  if (halved()) return corners[0] + ((corners[1] - corners[0]) * fu + (corners[2] - corners[0]) * fv);
  const Vec3f low = corners[0] + (corners[1] - corners[0]) * fu, high = corners[2] + (corners[3] - corners[2]) * fu;
  return low + (high - low) * fv;
}

VertexFace::VertexFace(const Scene& scene, const DicedMesh& mesh, const VertexViews& views, const Hit& hit,
                       SurfaceKey key, float pixel_area, uint32_t level)
    : mesh_(mesh),
      views_(views),
      shape_(mesh, isSpheres(mesh) ? hit.triangle : mesh.triangle_primitive[hit.triangle]),
      to_world_(toFloat(scene.instances[hit.instance].to_world)),
      hit_(hit),
      key_(key),
      level_(level),
      side_pixels_(std::sqrt(pixel_area) * float(1u << level)) {
  root_.diagonal = shape_.triangular();
  plan(root_);
}

Vec3f VertexFace::worldPoint(Vec2f uv) const {
  const FacePoint at = shape_.extrapolate(uv);
  if (isSpheres(mesh_)) {
    const Vec4f& s = mesh_.spheres[at.triangle];
    return to_world_.point(Vec3f{s.x, s.y, s.z} + toFloat(SphereNormal(2 * at.b1, 2 * at.b2).n) * s.w);
  }
  const uint32_t* corner = &mesh_.triangles[3 * size_t{at.triangle}];
  const Vec3f p0 = mesh_.positions[corner[0]], p1 = mesh_.positions[corner[1]], p2 = mesh_.positions[corner[2]];
  return to_world_.point(p0 + ((p1 - p0) * at.b1 + (p2 - p0) * at.b2));
}

// Reyes' bound and split: the size on the film decides between halves and a grid.
void VertexFace::plan(VertexGrid& grid) const {
  Net::Points points;
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column)
      points[row][column] = worldPoint({grid.origin.x + grid.size.x * 0.5f * float(column),
                                        grid.origin.y + grid.size.y * 0.5f * float(row)}) -
                            views_.origin();
  const Net net(points, grid.diagonal);
  const float scale = views_.pixelsPerRadian(points[grid.diagonal ? 0 : 1][1]) / side_pixels_;
  float u = scale * net.longestU(), v = scale * net.longestV();
  // Lines that are not at right angles, and those that converge, enclose less than the product of their lengths.
  const float micropolygons = scale * scale * net.area();
  if (shape_.triangular()) {
    // Keeps its shape when it is split, so that the diagonal stays one of micropolygons.
    u = v = std::max(std::sqrt(micropolygons), std::max(u, v) / kLongest);
  } else {
    const float shrink = std::clamp(std::sqrt(micropolygons / (u * v)), 1 / kLongest, 1.0f);
    if (shrink < 1) u *= shrink, v *= shrink;
  }
  const uint32_t nu = segments(u), nv = segments(v);
  const bool split_u = nu > kMaxGridCells && grid.size.x > kLeastSize;
  const bool split_v = nv > kMaxGridCells && grid.size.y > kLeastSize;
  if (split_u || split_v) {
    if (shape_.triangular())
      grid.split = VertexGrid::Split::Both;
    else
      grid.split = split_u && (!split_v || u >= v) ? VertexGrid::Split::U : VertexGrid::Split::V;
    return;
  }
  grid.nu = uint8_t(std::min(nu, kMaxGridCells));
  grid.nv = uint8_t(std::min(nv, kMaxGridCells));
  grid.tiles = std::make_unique<VertexTile[]>(grid.tileCount());
}

VertexGrid* VertexFace::expand(VertexGrid& grid) {
  const std::lock_guard lock(mutex_);
  if (grid.owned_children) return grid.owned_children.get();
  const uint32_t columns = grid.split == VertexGrid::Split::V ? 1 : 2,
                 rows = grid.split == VertexGrid::Split::U ? 1 : 2;
  auto children = std::make_unique<VertexGrid[]>(columns * rows);
  for (uint32_t k = 0; k < columns * rows; ++k) {
    VertexGrid& child = children[k];
    child.size = {grid.size.x / float(columns), grid.size.y / float(rows)};
    child.origin = {grid.origin.x + child.size.x * float(k % columns),
                    grid.origin.y + child.size.y * float(k / columns)};
    child.diagonal = grid.diagonal && (k == 1 || k == 2);
    const bool outside = grid.diagonal && k == 3;
    if (!outside) plan(child);
  }
  grid.owned_children = std::move(children);
  grid.children.store(grid.owned_children.get(), std::memory_order_release);
  return grid.owned_children.get();
}

GridCell VertexFace::cell(Vec2f uv) {
  if (shape_.triangular() && uv.x + uv.y > 1) uv = uv * (1 / (uv.x + uv.y));
  VertexGrid* grid = &root_;
  while (grid->split != VertexGrid::Split::None) {
    VertexGrid* children = grid->children.load(std::memory_order_acquire);
    if (!children) children = expand(*grid);
    const uint32_t right = uv.x >= grid->origin.x + grid->size.x * 0.5f;
    const uint32_t upper = uv.y >= grid->origin.y + grid->size.y * 0.5f;
    const bool beyond = grid->diagonal && right && upper;  // the middle of the diagonal: the corner of both
    switch (grid->split) {
      case VertexGrid::Split::U:
        grid = &children[right];
        break;
      case VertexGrid::Split::V:
        grid = &children[upper];
        break;
      default:
        grid = &children[beyond ? 1 : upper * 2 + right];
    }
  }
  const float x = (uv.x - grid->origin.x) / grid->size.x * float(grid->nu);
  const float y = (uv.y - grid->origin.y) / grid->size.y * float(grid->nv);
  int i = std::clamp(int(x), 0, grid->nu - 1), j = std::clamp(int(y), 0, grid->nv - 1);
  if (grid->diagonal) j = std::min(j, grid->nu - 1 - i);
  GridCell cell{
      this, grid, uint8_t(i), uint8_t(j), std::clamp(x - float(i), 0.0f, 1.0f), std::clamp(y - float(j), 0.0f, 1.0f)};
  if (grid->diagonal && i + j + 1 == grid->nu && cell.fu + cell.fv > 1) {
    const float sum = cell.fu + cell.fv;
    cell.fu /= sum, cell.fv /= sum;
  }
  return cell;
}

// (u, v) of the mesh and not the SurfacePoint's, which may be scaled.
GridCell VertexFace::cell(const Hit& hit) {
  if (isSpheres(mesh_)) return cell(Vec2f{std::min(2 * hit.b1, 1.0f), std::min(2 * hit.b2, 1.0f)});
  const uint32_t* corner = &mesh_.triangles[3 * size_t{hit.triangle}];
  const Vec2f p0 = mesh_.uv[corner[0]];
  const Vec2f uv = p0 + ((mesh_.uv[corner[1]] - p0) * hit.b1 + (mesh_.uv[corner[2]] - p0) * hit.b2);
  return cell(Vec2f{std::clamp(uv.x, 0.0f, 1.0f), std::clamp(uv.y, 0.0f, 1.0f)});
}

std::array<Hit, kTileVertices> VertexFace::vertices(const TileRequest& tile) const {
  const VertexGrid& grid = *tile.grid;
  const Vec2f step{grid.size.x / float(grid.nu), grid.size.y / float(grid.nv)};
  const uint32_t first_i = tile.tile % grid.tilesAcross() * kTileSide,
                 first_j = tile.tile / grid.tilesAcross() * kTileSide;
  std::array<Hit, kTileVertices> hits;
  for (uint32_t slot = 0; slot < kTileVertices; ++slot) {
    const uint32_t i = first_i + slot % kTileSide, j = first_j + slot / kTileSide;
    if (i > grid.nu || j > grid.nv || (grid.diagonal && i + j > grid.nu)) continue;
    const Vec2f uv = grid.vertexUv(i, j);
    auto point = shape_.find(uv);
    if (!point) point = shape_.nearest(uv, step);
    if (!point) continue;
    hits[slot] = {key_.instance, hit_.mesh, point->triangle, point->b1, point->b2, 0};
  }
  return hits;
}

uint32_t VertexFace::randomKey(const TileRequest& tile) const {
  const VertexGrid& grid = *tile.grid;
  const uint32_t place = pcg4d(std::bit_cast<uint32_t>(grid.origin.x), std::bit_cast<uint32_t>(grid.origin.y),
                               std::bit_cast<uint32_t>(grid.size.x), std::bit_cast<uint32_t>(grid.size.y))[0];
  return pcg4d(key_.instance, key_.primitive_side, place, tile.tile | level_ << 16)[0] & 0x7fffffffu;
}

VertexGrids::VertexGrids(const Scene& scene, const Settings& settings, const DicedMeshes& diced,
                         const VertexViews& views)
    : scene_(scene), diced_(diced), views_(views), rates_(scene, settings) {
  for (size_t m = 0; m < diced.size(); ++m)
    if (!std::is_sorted(diced[m].triangle_primitive.begin(), diced[m].triangle_primitive.end()))
      throw Error(ErrorKind::Internal, "triangles are not in the order of their primitives", scene.meshes[m].path);
}

GridCell VertexGrids::cell(const Hit& hit, SurfaceKey key, uint32_t level) {
  Faces& faces = faces_[level];
  const uint64_t id = uint64_t(key.instance) << 32 | key.primitive_side;
  auto entry = faces.find(id);
  if (entry == faces.end()) {
    const uint32_t mesh = scene_.prototypes[scene_.instances[hit.instance].prototype].meshes[hit.mesh];
    const float area = 1 / rates_.of(Layer::Direct, hit);
    entry = faces.emplace(id, std::make_unique<VertexFace>(scene_, diced_[mesh], views_, hit, key, area, level)).first;
  }
  return entry->second->cell(hit);
}

uint64_t VertexGrids::memoryBytes() const {
  uint64_t bytes = 0;
  for (const Faces& faces : faces_)
    for (const auto& entry : faces) bytes += entry.second->memoryBytes();
  forEachTile([&](const VertexTile& tile) {
    bytes += sizeof(VertexTile);
    for (const auto& values : tile.values) bytes += values ? sizeof(*values) : 0;
  });
  return bytes;
}

}  // namespace encore
