<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>AddressEdit</name>
    <message>
        <source>name or IP address</source>
        <translation>主机名或 IP 地址</translation>
    </message>
</context>
<context>
    <name>FormView</name>
    <message>
        <source>Add</source>
        <translation>添加</translation>
    </message>
    <message>
        <source>Remove</source>
        <translation>删除</translation>
    </message>
    <message>
        <source>Move up</source>
        <translation>上移</translation>
    </message>
    <message>
        <source>Move down</source>
        <translation>下移</translation>
    </message>
    <message>
        <source>Choose a row first.</source>
        <translation>请先选择一行。</translation>
    </message>
    <message>
        <source>All are listed.</source>
        <translation>已全部列出。</translation>
    </message>
    <message>
        <source>It is the first.</source>
        <translation>已是第一行。</translation>
    </message>
    <message>
        <source>It is the last.</source>
        <translation>已是最后一行。</translation>
    </message>
</context>
<context>
    <name>ImuSection</name>
    <message>
        <source>Several units on this table</source>
        <translation>此转台装多台产品</translation>
    </message>
    <message>
        <source>Link to the IMU</source>
        <translation>IMU 连接</translation>
    </message>
    <message>
        <source>This station has further IMUs on the same body; it takes one unit.</source>
        <translation>本工位在同一本体上还有其他 IMU，只能装一台产品。</translation>
    </message>
    <message>
        <source>Several units need a driven two-axis table with a link of its own.</source>
        <translation>多台产品需要有独立通信链路的电动双轴转台。</translation>
    </message>
</context>
<context>
    <name>LinkSection</name>
    <message>
        <source>Link to the table</source>
        <translation>转台连接</translation>
    </message>
    <message>
        <source>Link to the IMU</source>
        <translation>IMU 连接</translation>
    </message>
    <message>
        <source>Look for ports again</source>
        <translation>重新查找端口</translation>
    </message>
    <message>
        <source>Link to the unit in slot {0}</source>
        <translation>装夹位 {0} 的产品连接</translation>
    </message>
    <message>
        <source>This port is not present now.</source>
        <translation>当前未找到此端口。</translation>
    </message>
    <message>
        <source>this station&apos;s own</source>
        <translation>本工位单独设置</translation>
    </message>
    <message>
        <source>the profile&apos;s</source>
        <translation>按配置文件</translation>
    </message>
</context>
<context>
    <name>NewFileBar</name>
    <message>
        <source>copied from</source>
        <translation>复制自</translation>
    </message>
    <message>
        <source>Create</source>
        <translation>新建</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>This name is taken; choose another.</source>
        <translation>此名称已被占用，请换一个。</translation>
    </message>
    <message>
        <source>Only letters a to z, digits, - and _; a letter or digit first.</source>
        <translation>只能用英文字母、数字、- 和 _，且以字母或数字开头。</translation>
    </message>
    <message>
        <source>Type a name first.</source>
        <translation>请先输入名称。</translation>
    </message>
</context>
<context>
    <name>PersonalSection</name>
    <message>
        <source>Folder of the runs</source>
        <translation>标定记录文件夹</translation>
    </message>
    <message>
        <source>Set the PIN</source>
        <translation>设置密码</translation>
    </message>
    <message>
        <source>This computer</source>
        <translation>本机设置</translation>
    </message>
    <message>
        <source>The engineer&apos;s PIN</source>
        <translation>工程师密码</translation>
    </message>
    <message>
        <source>Choose a folder</source>
        <translation>选择文件夹</translation>
    </message>
    <message>
        <source>after every scan</source>
        <translation>每次扫描后</translation>
    </message>
    <message>
        <source>empty: the PIN of this site</source>
        <translation>留空：本站点的密码</translation>
    </message>
    <message>
        <source>the PIN of this site</source>
        <translation>本站点的密码</translation>
    </message>
    <message>
        <source>Change the PIN</source>
        <translation>修改密码</translation>
    </message>
    <message>
        <source>The two are not the same.</source>
        <translation>两次输入不一致。</translation>
    </message>
    <message>
        <source>Too short: at least {0} characters.</source>
        <translation>太短：至少 {0} 个字符。</translation>
    </message>
    <message>
        <source>The PIN has been changed.</source>
        <translation>密码已修改。</translation>
    </message>
</context>
<context>
    <name>PortBox</name>
    <message>
        <source>choose or type a port</source>
        <translation>选择或输入端口</translation>
    </message>
</context>
<context>
    <name>ProfilesSection</name>
    <message>
        <source>Line {0}: {1}</source>
        <translation>第 {0} 行：{1}</translation>
    </message>
    <message>
        <source>New from copy</source>
        <translation>复制新建</translation>
    </message>
    <message>
        <source>Text</source>
        <translation>文本</translation>
    </message>
    <message>
        <source>Compare</source>
        <translation>比较</translation>
    </message>
    <message>
        <source>File</source>
        <translation>文件</translation>
    </message>
    <message>
        <source>Kind of file</source>
        <translation>文件类别</translation>
    </message>
    <message>
        <source>Versions</source>
        <translation>版本</translation>
    </message>
    <message>
        <source>Restore</source>
        <translation>恢复</translation>
    </message>
    <message>
        <source>Products</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>IMUs</source>
        <translation>IMU</translation>
    </message>
    <message>
        <source>Tables</source>
        <translation>转台</translation>
    </message>
    <message>
        <source>Stations</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>found, not saved here</source>
        <translation>原有文件，非在此保存</translation>
    </message>
    <message>
        <source>  ·  current</source>
        <translation>  ·  当前</translation>
    </message>
    <message>
        <source>Choose a version in the list.</source>
        <translation>请先在列表中选择版本。</translation>
    </message>
    <message>
        <source>Puts its text into the editor; saving makes it a new version.</source>
        <translation>把该版本放回编辑器；保存后成为新版本。</translation>
    </message>
    <message>
        <source>the saved text</source>
        <translation>已保存的文本</translation>
    </message>
    <message>
        <source>version {0}</source>
        <translation>版本 {0}</translation>
    </message>
    <message>
        <source>the present text</source>
        <translation>当前文本</translation>
    </message>
    <message>
        <source>The present text is the same as {0}.</source>
        <translation>当前文本与{0}相同。</translation>
    </message>
</context>
<context>
    <name>RecordsSection</name>
    <message>
        <source>Shared records</source>
        <translation>共享记录</translation>
    </message>
    <message>
        <source>Choose a folder</source>
        <translation>选择文件夹</translation>
    </message>
    <message>
        <source>Last exchange: {0}</source>
        <translation>上次交换：{0}</translation>
    </message>
    <message>
        <source>Not exchanged yet</source>
        <translation>尚未交换</translation>
    </message>
    <message>
        <source>Archive of logs</source>
        <translation>数据记录归档</translation>
    </message>
</context>
<context>
    <name>SiteSection</name>
    <message>
        <source>Body +y at home, seen from above.</source>
        <translation>零位时载体 +y 轴的指向（俯视）。</translation>
    </message>
    <message>
        <source>The azimuth is found from the data: levelling and gyrocompassing at the first rest.</source>
        <translation>方位角由数据求出：在首次静止时调平并陀螺寻北。</translation>
    </message>
    <message>
        <source>Site</source>
        <translation>站址</translation>
    </message>
    <message>
        <source>Normal gravity at this latitude and height (WGS-84)</source>
        <translation>此纬度和高度的正常重力（WGS-84）</translation>
    </message>
    <message>
        <source>given here</source>
        <translation>在此填写</translation>
    </message>
    <message>
        <source>found from the data</source>
        <translation>由数据求出</translation>
    </message>
    <message>
        <source>normal gravity, computed</source>
        <translation>正常重力（计算值）</translation>
    </message>
    <message>
        <source>surveyed, given here</source>
        <translation>实测值（在此填写）</translation>
    </message>
</context>
<context>
    <name>StationPage</name>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>Save and go on</source>
        <translation>保存并继续</translation>
    </message>
    <message>
        <source>Discard and go on</source>
        <translation>放弃并继续</translation>
    </message>
    <message>
        <source>Stay here</source>
        <translation>留在本页</translation>
    </message>
    <message>
        <source>Unsaved changes</source>
        <translation>有未保存的修改</translation>
    </message>
    <message>
        <source>Not saved</source>
        <translation>未能保存</translation>
    </message>
    <message>
        <source>● Not saved: {0}</source>
        <translation>● 未保存：{0}</translation>
    </message>
    <message>
        <source>✓ Saved: {0}</source>
        <translation>✓ 已保存：{0}</translation>
    </message>
    <message>
        <source>Read only: an engineer unlocks it.</source>
        <translation>只读：修改需工程师解锁。</translation>
    </message>
    <message>
        <source>Correct first, in “{0}”: {1}</source>
        <translation>请先改正“{0}”：{1}</translation>
    </message>
    <message>
        <source>New from copy</source>
        <translation>复制新建</translation>
    </message>
    <message>
        <source>Save</source>
        <translation>保存</translation>
    </message>
    <message>
        <source>Discard</source>
        <translation>放弃</translation>
    </message>
    <message>
        <source>A run is going on; changes can be saved when it has ended.</source>
        <translation>正在标定，结束后可保存所作修改。</translation>
    </message>
    <message>
        <source>Link to the table</source>
        <translation>转台连接</translation>
    </message>
    <message>
        <source>Site</source>
        <translation>站址</translation>
    </message>
    <message>
        <source>Shared records</source>
        <translation>共享记录</translation>
    </message>
    <message>
        <source>Table</source>
        <translation>转台</translation>
    </message>
    <message>
        <source>Profiles and products</source>
        <translation>配置与产品</translation>
    </message>
    <message>
        <source>This computer</source>
        <translation>本机设置</translation>
    </message>
    <message>
        <source>Only an engineer may change this: press the padlock at the top right.</source>
        <translation>只有工程师可以修改：请点右上角的锁。</translation>
    </message>
    <message>
        <source>{0} (virtual bench)</source>
        <translation>{0}（虚拟台）</translation>
    </message>
</context>
<context>
    <name>StationSection</name>
    <message>
        <source>Hand-over folder</source>
        <translation>结果交付文件夹</translation>
    </message>
    <message>
        <source>Virtual bench</source>
        <translation>虚拟台</translation>
    </message>
    <message>
        <source>Hardware</source>
        <translation>真实设备</translation>
    </message>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>Choose a folder</source>
        <translation>选择文件夹</translation>
    </message>
    <message>
        <source>opened by the bench</source>
        <translation>由虚拟台打开</translation>
    </message>
    <message>
        <source>turned by hand</source>
        <translation>手动转动</translation>
    </message>
    <message>
        <source>Table</source>
        <translation>转台</translation>
    </message>
    <message>
        <source>IMU</source>
        <translation>IMU</translation>
    </message>
    <message>
        <source>azimuth from the data</source>
        <translation>方位角由数据求出</translation>
    </message>
    <message>
        <source>azimuth {0}°</source>
        <translation>方位角 {0}°</translation>
    </message>
    <message>
        <source>Slots</source>
        <translation>装夹位</translation>
    </message>
    <message>
        <source>Site</source>
        <translation>站址</translation>
    </message>
    <message>
        <source>Gravity</source>
        <translation>重力</translation>
    </message>
    <message>
        <source>normal</source>
        <translation>正常重力</translation>
    </message>
    <message>
        <source>It came with the program; saving a change makes a copy for this site.</source>
        <translation>随软件提供；保存修改后成为本站自己的副本。</translation>
    </message>
    <message>
        <source>Version {0} of this site&apos;s own file.</source>
        <translation>本站文件的版本 {0}。</translation>
    </message>
    <message>
        <source>This site&apos;s own file, not saved from here yet.</source>
        <translation>本站自己的文件，尚未在此保存过。</translation>
    </message>
    <message>
        <source>SHA-256 {0}, as in every result</source>
        <translation>SHA-256 {0}（写入每份结果）</translation>
    </message>
</context>
<context>
    <name>TableSection</name>
    <message>
        <source>Outer</source>
        <translation>外框</translation>
    </message>
    <message>
        <source>Inner</source>
        <translation>内框</translation>
    </message>
    <message>
        <source>From the table profile “{0}”. Changes hold for every station with this profile.</source>
        <translation>来自转台配置“{0}”。修改对使用它的所有工位生效。</translation>
    </message>
    <message>
        <source>Table</source>
        <translation>转台</translation>
    </message>
    <message>
        <source>Accuracy</source>
        <translation>精度</translation>
    </message>
    <message>
        <source>Outer axis</source>
        <translation>外框</translation>
    </message>
    <message>
        <source>Inner axis</source>
        <translation>内框</translation>
    </message>
</context>
<context>
    <name>TestPanel</name>
    <message>
        <source>A run is going on; test when it has ended.</source>
        <translation>正在标定，结束后再测试。</translation>
    </message>
    <message>
        <source>A test is going on.</source>
        <translation>正在测试。</translation>
    </message>
    <message>
        <source>A fault is being reset.</source>
        <translation>正在复位故障。</translation>
    </message>
    <message>
        <source>Correct what is marked first.</source>
        <translation>请先改正标出的项。</translation>
    </message>
    <message>
        <source>Connection test</source>
        <translation>连接测试</translation>
    </message>
    <message>
        <source>Expected: the IMU of product</source>
        <translation>按此产品的 IMU 核对</translation>
    </message>
    <message>
        <source>Test the table</source>
        <translation>测试转台</translation>
    </message>
    <message>
        <source>Test the IMU</source>
        <translation>测试 IMU</translation>
    </message>
</context>
<context>
    <name>_Confirmation</name>
    <message>
        <source>Confirm: the station is at this site</source>
        <translation>确认：工位就在此处</translation>
    </message>
</context>
<context>
    <name>_SlotsView</name>
    <message>
        <source>The station then takes one unit, with the link of this slot and the axes of the platform.</source>
        <translation>本工位随后只装一台产品，沿用此装夹位的连接，本体轴与平台轴一致。</translation>
    </message>
</context>
</TS>
