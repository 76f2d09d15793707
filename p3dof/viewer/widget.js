// The page in a cell of a notebook: an iframe, whose messages go to Python through the notebook's own connection.
function render({ model, el }) {
  const view = Math.random().toString(36).slice(2);
  const frame = document.createElement("iframe");
  frame.setAttribute("sandbox", "allow-scripts allow-downloads");
  frame.title = model.get("title");
  frame.style.cssText = `display: block; width: 100%; height: ${model.get("height")}px; border: 0`;

  const send = (message) => model.send({ view, message });
  const said = ({ source, data }) => {
    if (source === frame.contentWindow && data && data.p3dof) send(data.p3dof);
  };
  const heard = (content, buffers) => {
    if (content.view && content.view !== view) return;
    if (content.closed) return lost();
    const { buffer, byteOffset, byteLength } = buffers[0];
    const data = buffer.slice(byteOffset, byteOffset + byteLength);
    if (content.page) frame.srcdoc = new TextDecoder().decode(data);
    else frame.contentWindow.postMessage(data, "*", [data]);
  };
  const lost = () => frame.contentWindow.postMessage({ p3dof: "closed" }, "*");
  const checked = () => model.comm_live === false && lost();
  window.addEventListener("message", said);
  model.on("msg:custom", heard);
  model.on("comm_live_update", checked);
  el.append(frame);
  send({ type: "page" });
  return () => {
    window.removeEventListener("message", said);
    model.off("msg:custom", heard);
    model.off("comm_live_update", checked);
  };
}

export default { render };
