"use strict";
// The client of `pcsg lsp`, and the commands of its lenses, which run in a terminal.

const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

function command() {
  return vscode.workspace.getConfiguration("pcsg").get("command", "pcsg");
}

/** Run a verb on a file in the terminal, after saving it. */
async function runVerb(verb, uri) {
  const file = uri ? vscode.Uri.parse(String(uri)) : vscode.window.activeTextEditor?.document.uri;
  if (!file || file.scheme !== "file") {
    vscode.window.showWarningMessage("Save the grammar to a file first.");
    return;
  }
  const open = vscode.workspace.textDocuments.find((d) => d.uri.fsPath === file.fsPath);
  if (open && open.isDirty) await open.save();
  // A process of its own, not text for a shell: a file may have any name.
  const task = new vscode.Task(
    { type: "pcsg", verb },
    vscode.TaskScope.Workspace,
    verb,
    "pcsg",
    new vscode.ProcessExecution(command(), [verb, file.fsPath])
  );
  await vscode.tasks.executeTask(task);
}

async function activate(context) {
  for (const verb of ["render", "view"]) {
    context.subscriptions.push(
      vscode.commands.registerCommand(`pcsg.${verb}`, (uri) => runVerb(verb, uri))
    );
  }
  client = new LanguageClient(
    "pcsg",
    "pcsg",
    { command: command(), args: ["lsp"] },
    { documentSelector: [{ language: "pcsg" }] }
  );
  try {
    await client.start();
  } catch (error) {
    vscode.window.showWarningMessage(
      `pcsg lsp does not start (${error.message}). It needs the extra lsp; pcsg.command says where pcsg is.`
    );
  }
}

function deactivate() {
  return client?.stop();
}

module.exports = { activate, deactivate };
