#pragma once

#include "server/service/evidence_intake.h"
#include "server/service/integrator.h"
#include "server/service/map_service.h"
#include "server/service/session_guard.h"
#include "server/service/shared_map.h"
#include "server/service/tile_cache.h"
#include "server/service/update_checker.h"
#include "storage/map_store.h"

#include <atomic>

namespace mapp {

/// Parts in the order in which they need each other: threads come last and end first.
struct MapService::Impl {
  Impl(MapStore& map_store, const MapServiceOptions& options)
      : store(map_store),
        tiles(map_store, options.cache_bytes),
        guard(map_store, tiles, events, WithRegistrar(options.guard)),
        optimizer(map_store, tiles, events, WithStepTimes(options.optimizer)),
        registrar(map_store, tiles, events, WithGuard(WithOptimizer(WithStepTimes(options.registrar)))),
        integrator(map_store, tiles, events, registrar, guard,
                   {.max_packet_bytes = options.max_keyframe_bytes,
                    .association = {},
                    .step_times = &step_times,
                    .replay = options.replay}),
        shared_map(map_store),
        evidence(map_store, options.evidence) {}

  template <typename Options>
  Options WithStepTimes(Options options) {
    options.step_times = &step_times;
    return options;
  }

  RegistrarOptions WithOptimizer(RegistrarOptions options) {
    options.on_optimization_due = [this](SessionId session) { optimizer.OnSessionClosed(session); };
    return options;
  }

  RegistrarOptions WithGuard(RegistrarOptions options) {
    options.guard = &guard;
    return options;
  }

  GuardOptions WithRegistrar(GuardOptions options) {
    options.on_quarantined = [this, told = options.on_quarantined](const QuarantinedSession& quarantined) {
      registrar.OnSessionQuarantined(quarantined.map, quarantined.session, quarantined.retired_frames);
      if (told) told(quarantined);
    };
    return options;
  }

  MapStore& store;
  StepTimes step_times;
  SessionEvents events;
  TileCache tiles;
  SessionGuard guard;
  Optimizer optimizer;
  Registrar registrar;
  Integrator integrator;
  SharedMapSender shared_map;
  EvidenceIntake evidence;
  UpdateOptions update_options;
  ScanOptions scan_options;
  std::atomic<bool> detecting = false;
  std::map<MapId, ThingMemory> thing_memory;  ///< of DetectChanges, for whoever has the claim on `detecting`

  /// Runs `decide` in one change of the store, and tells tiles and devices of it.
  Status Decide(const CallContext& context, const std::string& map_name, ChangeDecision& decision,
                const std::function<StatusOr<ChangeDecision>(MapWriter&, const MapRecord&)>& decide);
  void Announce(MapId map, const ChangeDecision& decision);
  /// What detection keeps of the map; forgets what it keeps of maps that are no more.
  StatusOr<ThingMemory*> MemoryOf(const std::string& map_name);
};

}  // namespace mapp
