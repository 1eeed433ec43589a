// Rolls out worlds in Jolt Physics, for benchmarks/peers/jolt.py; rollout_request.h says what it
// reads.
//
// The flags: whether bodies at rest sleep, whether each simulation has a world of its own. Without
// the latter all simulations are rooms of one world, too far apart to meet.
//
// Jolt combines coefficients of bodies by a rule and has one friction and none of rolling. A body
// gets μ_d and e of its first pair; as all pairs of a request are alike, every rule gives these.

#include <Jolt/Jolt.h>

#include <Jolt/Core/Factory.h>
#include <Jolt/Core/JobSystemSingleThreaded.h>
#include <Jolt/Core/TempAllocator.h>
#include <Jolt/Physics/Body/BodyCreationSettings.h>
#include <Jolt/Physics/Body/BodyInterface.h>
#include <Jolt/Physics/Collision/BroadPhase/BroadPhaseLayerInterfaceTable.h>
#include <Jolt/Physics/Collision/BroadPhase/ObjectVsBroadPhaseLayerFilterTable.h>
#include <Jolt/Physics/Collision/ObjectLayerPairFilterTable.h>
#include <Jolt/Physics/Collision/Shape/BoxShape.h>
#include <Jolt/Physics/Collision/Shape/CapsuleShape.h>
#include <Jolt/Physics/Collision/Shape/PlaneShape.h>
#include <Jolt/Physics/Collision/Shape/SphereShape.h>
#include <Jolt/Physics/PhysicsSettings.h>
#include <Jolt/Physics/PhysicsSystem.h>
#include <Jolt/RegisterTypes.h>

#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <vector>

#include "rollout_request.h"

namespace {

constexpr float kRoomDistance = 40.0f;   // m between the middles of two rooms of one world
constexpr float kReach = 15.0f;          // m that a plane's bounding box reaches
constexpr float kBounceSpeed = 0.1f;     // m/s, below which contacts do not bounce; g · 10 ms
constexpr float kConvexRadius = 0.005f;  // m by which a box's edges are rounded
constexpr float kMostSpin = 1e3f;        // rad/s; Jolt's own limit, 47, cuts spins after bounces
constexpr JPH::uint kTemporaryBytes = 32 * 1024 * 1024;

enum Layer : JPH::ObjectLayer { kStatic, kMoving, kLayers };

JPH::Vec3 vec3(const double* v) {
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

// Which layers meet: moving bodies all others.
struct Layers {
  Layers() : broad(kLayers, kLayers), pairs(kLayers), filter(broad, kLayers, pairs, kLayers) {}

  struct Broad : JPH::BroadPhaseLayerInterfaceTable {
    Broad(JPH::uint objects, JPH::uint layers)
        : JPH::BroadPhaseLayerInterfaceTable(objects, layers) {
      for (JPH::uint8 layer = 0; layer < kLayers; ++layer) {
        MapObjectToBroadPhaseLayer(layer, JPH::BroadPhaseLayer(layer));
      }
    }
  };
  struct Pairs : JPH::ObjectLayerPairFilterTable {
    explicit Pairs(JPH::uint layers) : JPH::ObjectLayerPairFilterTable(layers) {
      EnableCollision(kMoving, kMoving);
      EnableCollision(kMoving, kStatic);
    }
  };

  Broad broad;
  Pairs pairs;
  JPH::ObjectVsBroadPhaseLayerFilterTable filter;
};

// One Jolt world with the rooms of some simulations of a request.
class World {
 public:
  World(const Request& request, int first, int count, const Layers& layers)
      : request_(request), first_(first), count_(count) {
    const JPH::uint bodies = count * (request.n_objects + request.n_planes);
    const JPH::uint pairs = 64 + count * request.n_objects * (request.n_objects + request.n_planes);
    system_.Init(bodies, 0, pairs, pairs, layers.broad, layers.filter, layers.pairs);
    system_.SetGravity(vec3(request.gravity.data()));
    JPH::PhysicsSettings settings;
    settings.mMinVelocityForRestitution = kBounceSpeed;
    settings.mAllowSleeping = request.flags[0];
    system_.SetPhysicsSettings(settings);
    for (int room = 0; room < count; ++room) {
      for (int p = 0; p < request.n_planes; ++p) add_plane(room, p);
      for (int i = 0; i < request.n_objects; ++i) add_object(room, i);
    }
    system_.OptimizeBroadPhase();
  }

  void simulate(JPH::TempAllocator& memory, JPH::JobSystem& jobs, double* positions) {
    reset();
    for (int step = 0; step < request_.n_steps; ++step) {
      if (system_.Update(static_cast<float>(request_.step), 1, &memory, &jobs) !=
          JPH::EPhysicsUpdateError::None) {
        throw std::runtime_error("Jolt's world is too small for its contacts");
      }
      write(step, positions);
    }
  }

 private:
  // Rooms stand in a square about the origin, where single precision is finest.
  JPH::Vec3 middle(int room) const {
    const int side = static_cast<int>(std::ceil(std::sqrt(count_)));
    const float half = 0.5f * static_cast<float>(side - 1);
    return kRoomDistance * JPH::Vec3(static_cast<float>(room % side) - half,
                                     static_cast<float>(room / side) - half, 0.0f);
  }

  const double* first_pair(int i) const {
    return request_.coefficients +
           std::size_t{4} * i * (request_.n_objects + request_.n_planes) + 4 * request_.n_objects;
  }

  void add(JPH::BodyCreationSettings& settings, const double* pair, JPH::Body** body) {
    settings.mFriction = static_cast<float>(pair[1]);
    settings.mRestitution = static_cast<float>(pair[3]);
    *body = system_.GetBodyInterface().CreateBody(settings);
    if (*body == nullptr) throw std::runtime_error("Jolt's world is too small for its bodies");
    system_.GetBodyInterface().AddBody((*body)->GetID(), JPH::EActivation::Activate);
  }

  void add_plane(int room, int p) {
    const double* plane = request_.planes + 4 * p;
    const JPH::Vec3 normal = vec3(plane);
    const JPH::Ref<JPH::Shape> shape =
        new JPH::PlaneShape(JPH::Plane(normal, 0.0f), nullptr, kReach);
    JPH::BodyCreationSettings settings(
        shape, middle(room) + static_cast<float>(plane[3]) * normal, JPH::Quat::sIdentity(),
        JPH::EMotionType::Static, kStatic);
    JPH::Body* body = nullptr;
    add(settings, first_pair(0), &body);
  }

  void add_object(int room, int i) {
    const double* object = request_.objects + 8 * i;
    const JPH::Vec3 inertia = vec3(object + 5);
    const bool capsule = object[0] == kCapsule;
    JPH::BodyCreationSettings settings(shape(object), middle(room), JPH::Quat::sIdentity(),
                                       JPH::EMotionType::Dynamic, kMoving);
    settings.mOverrideMassProperties = JPH::EOverrideMassProperties::MassAndInertiaProvided;
    settings.mMassPropertiesOverride.mMass = static_cast<float>(object[4]);
    // A capsule's axis is z in the request and y in Jolt.
    settings.mMassPropertiesOverride.mInertia =
        JPH::Mat44::sScale(capsule ? inertia.Swizzle<0, 2, 1>() : inertia);
    settings.mLinearDamping = settings.mAngularDamping = 0.0f;
    settings.mMaxAngularVelocity = kMostSpin;
    settings.mApplyGyroscopicForce = true;
    add(settings, first_pair(i), &bodies_.emplace_back());
  }

  static JPH::ShapeRefC shape(const double* object) {
    const JPH::Vec3 size = vec3(object + 1);
    switch (static_cast<int>(object[0])) {
      case kSphere: return new JPH::SphereShape(size.GetX());
      case kBox: return new JPH::BoxShape(0.5f * size, kConvexRadius);
      case kCapsule: return new JPH::CapsuleShape(0.5f * size.GetY(), size.GetX());
      default: throw std::runtime_error("the request has an unknown shape");
    }
  }

  void reset() {
    const JPH::Quat lying = JPH::Quat::sRotation(JPH::Vec3::sAxisX(), 0.5f * JPH::JPH_PI);
    JPH::BodyInterface& interface = system_.GetBodyInterfaceNoLock();
    const double* s = request_.starts + std::size_t{13} * request_.n_objects * first_;
    for (std::size_t k = 0; k < bodies_.size(); ++k, s += 13) {
      const double* object = request_.objects + 8 * (k % request_.n_objects);
      JPH::Quat turn = JPH::Quat(JPH::Vec4(vec3(s + 3), static_cast<float>(s[6]))).Normalized();
      if (object[0] == kCapsule) turn = turn * lying;
      const JPH::Vec3 at = middle(static_cast<int>(k) / request_.n_objects) + vec3(s);
      interface.SetPositionRotationAndVelocity(bodies_[k]->GetID(), at, turn, vec3(s + 7),
                                               vec3(s + 10));
    }
  }

  void write(int step, double* positions) const {
    for (std::size_t k = 0; k < bodies_.size(); ++k) {
      const int room = static_cast<int>(k) / request_.n_objects;
      const JPH::Vec3 at = bodies_[k]->GetPosition() - middle(room);
      double* row = positions + 3 * ((first_ * request_.n_objects + k) * request_.n_steps + step);
      for (int axis = 0; axis < 3; ++axis) row[axis] = at[axis];
    }
  }

  const Request& request_;
  int first_, count_;
  JPH::PhysicsSystem system_;
  std::vector<JPH::Body*> bodies_;  // those that move, room by room
};

std::vector<double> answer(const Request& request) {
  static const Layers layers;
  static JPH::TempAllocatorImplWithMallocFallback memory(kTemporaryBytes);
  static JPH::JobSystemSingleThreaded jobs(JPH::cMaxPhysicsJobs);
  const int rooms = request.flags[1] ? 1 : request.n_simulations;
  std::vector<std::unique_ptr<World>> worlds;
  for (int first = 0; first < request.n_simulations; first += rooms) {
    worlds.push_back(std::make_unique<World>(request, first, rooms, layers));
  }
  std::vector<double> result(1 + std::size_t{3} * request.n_simulations * request.n_objects *
                                     request.n_steps);
  const auto start = std::chrono::steady_clock::now();
  for (const auto& world : worlds) world->simulate(memory, jobs, &result[1]);
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  result[0] = took.count();
  return result;
}

}  // namespace

int main() {
  JPH::RegisterDefaultAllocator();
  JPH::Factory::sInstance = new JPH::Factory();
  JPH::RegisterTypes();
  const int status = serve(answer);
  JPH::UnregisterTypes();
  delete JPH::Factory::sInstance;
  return status;
}
