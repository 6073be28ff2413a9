// What a page begins with: its panel, what it holds, and where it says what went wrong.

const element = (id) => document.getElementById(id);

// Put a panel into the page. more: HTML beside it. Returns what the page holds, what its address asks for, and a function
// that shows a line, or hides it.
function layOut(panel, more = "") {
  const data = JSON.parse(element("live-data").textContent), query = new URLSearchParams(location.hash.slice(1) || location.search);
  document.body.insertAdjacentHTML("beforeend", `<div id="relight">${panel}</div><div id="relight-message"></div>${more}`);
  const notify = (text) => {
    element("relight-message").textContent = text;
    element("relight-message").style.display = text ? "block" : "none";
  };
  try {
    if (localStorage.getItem("controlsPanelOpen") === null) localStorage.setItem("controlsPanelOpen", "false"); // the viewer's list of keys
  } catch { /* storage may be denied */ }
  return { data, query, notify };
}

// Promises of files by name: packed in this page, or beside it.
function readFiles({ files, packed }) {
  return Object.fromEntries(files.map((name) => [name, packed ? unpacked[name] : beside(name)]));
}

async function beside(name) {
  const answer = await fetch(name);
  if (!answer.ok) throw new Error(`${name} is missing beside this page`);
  return new Uint8Array(await answer.arrayBuffer());
}
