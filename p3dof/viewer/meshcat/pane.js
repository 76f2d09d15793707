"use strict";
// MeshCat's viewer in its part of the window.

const pane = document.getElementById("pane");
window.viewer = new MeshCat.Viewer(pane);
{
  const resize = viewer.set_3d_pane_size.bind(viewer);
  viewer.set_3d_pane_size = () => resize(pane.clientWidth, Math.max(pane.clientHeight, 1));
}
