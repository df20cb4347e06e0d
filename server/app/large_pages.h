// Large pages under large arrays. Called once, by main().
#pragma once

namespace heliograph::server {

/// Asks the system for pages of 2 MiB under what the heap gives out from 2 MiB on: meshes,
/// textures, trees and tables, which rays read all over. Small things keep small pages, so the
/// daemon's memory stays as it is. Does nothing where the heap is not jemalloc or the system has no
/// such pages.
void use_large_pages();

}  // namespace heliograph::server
