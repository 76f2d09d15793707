"use strict";
// Draws what Python draws with MeshCat, and says when Python is gone.

new ResizeObserver(() => viewer.set_3d_pane_size()).observe(pane);
viewer.connect(`ws://${location.host}/scene${location.search}`);  // the token goes with it
viewer.connection.onclose = (event) => {
  document.getElementById("note").textContent =
    `${event.reason || "Python is gone"}: what was drawn stays; load the page again to connect.`;
};
