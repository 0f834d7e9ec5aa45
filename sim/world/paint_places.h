#pragma once

#include "mapp/base/rng.h"
#include "mapp/image/image.h"
#include "sim/paint.h"

#include <string>

namespace mapp::sim {

// Surfaces of garages, streets, squares and halls. As sim/paint.h.

/// Tar with chippings, cracks, mended patches and stains of oil.
GrayImage PaintAsphalt(const Canvas& canvas, Rng& rng);
/// Slabs or setts of stone in courses, some of them darker or cracked.
GrayImage PaintPaving(const Canvas& canvas, Rng& rng);
/// Rendered wall with cracks, patches and scribbles.
GrayImage PaintPlaster(const Canvas& canvas, Rng& rng);
/// Bricks in equal courses: pieces of it join.
GrayImage PaintMasonry(const Canvas& canvas, Rng& rng);
// One storey of one window, with the wall around it, in four styles: light plaster, bricks, dark plaster, panels.
GrayImage PaintLightBay(const Canvas& canvas, Rng& rng);
GrayImage PaintBrickBay(const Canvas& canvas, Rng& rng);
GrayImage PaintDarkBay(const Canvas& canvas, Rng& rng);
GrayImage PaintPanelBay(const Canvas& canvas, Rng& rng);
/// A shop's front: panes with goods behind, a door, a sign above.
GrayImage PaintShopFront(const Canvas& canvas, Rng& rng);
/// A door with its frame, handle and a sign.
GrayImage PaintDoor(const Canvas& canvas, Rng& rng);
/// A flat roof: felt in lanes with seams, puddles and gravel.
GrayImage PaintRoof(const Canvas& canvas, Rng& rng);
/// Leaves, bright on dark.
GrayImage PaintFoliage(const Canvas& canvas, Rng& rng);
/// The front of a machine: covers with screws, dials, switches, labels, slots.
GrayImage PaintMachinePanel(const Canvas& canvas, Rng& rng);
/// Corrugated sheet with bolts and rust.
GrayImage PaintSheetMetal(const Canvas& canvas, Rng& rng);
/// Rungs between two rails before a dark wall.
GrayImage PaintLadder(const Canvas& canvas, Rng& rng);
/// A window of many panes, bright, as in a hall's wall.
GrayImage PaintPanes(const Canvas& canvas, Rng& rng);
/// Slanting stripes of warning.
GrayImage PaintStripes(const Canvas& canvas, Rng& rng);
/// Woven cloth with folds, a print and a seam.
GrayImage PaintCloth(const Canvas& canvas, Rng& rng);
/// A plate with a frame and `text` on it.
GrayImage PaintSign(const Canvas& canvas, const std::string& text, Rng& rng);
/// An arrow along +u, worn road paint on tar.
GrayImage PaintArrow(const Canvas& canvas, Rng& rng);
/// A worn line of road paint.
GrayImage PaintRoadLine(const Canvas& canvas, Rng& rng);
/// A lamp's bright tube in its housing.
GrayImage PaintTube(const Canvas& canvas, Rng& rng);

}  // namespace mapp::sim
